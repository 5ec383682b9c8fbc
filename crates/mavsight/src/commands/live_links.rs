//! The ways out of a live flight.

use crate::cli::{Live, WrongCall};
use mavsight_flight::Vehicle;
use mavsight_link::{Body, Event, Fix, LinkError, LiveSection, Outlet, Rerun};
use mavsight_live::{Listener, Listeners, marker_views};

/// What the session switches on, and the command line in addition.
fn options(session: &LiveSection, args: &Live) -> LiveSection {
    let mut links = session.clone();
    let set = |place: &mut String, own: &Option<String>| own.iter().for_each(|a| place.clone_from(a));
    if let Some(own) = &args.mavlink {
        set(&mut links.mavlink.get_or_insert_default().address, own);
    }
    if let Some(own) = &args.natnet {
        set(&mut links.natnet.get_or_insert_default().address, own);
    }
    if let Some(own) = &args.vrpn {
        set(&mut links.vrpn.get_or_insert_default().address, own);
    }
    if let Some(own) = &args.lines {
        set(&mut links.json.get_or_insert_default().tcp, own);
    }
    if let Some(own) = &args.zenoh {
        let listen = &mut links.zenoh.get_or_insert_default().listen;
        own.iter().for_each(|endpoint| *listen = vec![endpoint.clone()]);
    }
    links
}

pub(super) fn add_links(
    all: &mut Listeners,
    vehicle: &Vehicle,
    session: &LiveSection,
    args: &Live,
) -> anyhow::Result<()> {
    let body = Body::new(&vehicle.name, marker_views(vehicle));
    let outlets =
        mavsight_link::open(&options(session, args), &body).map_err(|e| WrongCall(e.to_string()))?;
    let file = args.rerun.as_deref().map(Rerun::create).transpose()?;
    let file = file.map(|f| Box::new(f) as Box<dyn Outlet>);
    for outlet in outlets.into_iter().chain(file) {
        all.add(Box::new(Link { outlet, said: None }))?;
    }
    Ok(())
}

struct Link {
    outlet: Box<dyn Outlet>,
    said: Option<String>,
}

impl Link {
    fn report(&mut self, sent: Result<(), LinkError>) {
        let fault = sent.err().map(|e| e.to_string());
        if let Some(fault) = fault.filter(|f| self.said.as_ref() != Some(f)) {
            eprintln!("mavsight: {fault}");
            self.said = Some(fault);
        }
    }
}

impl Listener for Link {
    fn fix(&mut self, fix: &Fix) {
        let sent = self.outlet.send(fix);
        self.report(sent);
    }

    fn event(&mut self, event: &Event) {
        let sent = self.outlet.event(event);
        self.report(sent);
    }
}
