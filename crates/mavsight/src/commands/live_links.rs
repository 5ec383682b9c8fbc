//! The ways out of a live flight.

use crate::cli::{Live, WrongCall};
use anyhow::Result;
use mavsight_flight::Vehicle;
use mavsight_link::{Body, Event, Fix, LinkOptions, MarkerView, Outlet, Rerun};
use mavsight_live::{Listener, Listeners};
use mavsight_session::LiveSection;

/// What the session switches on, and the command line beside it.
fn options(session: &LiveSection, args: &Live) -> LinkOptions {
    let mut links = session.links();
    if let Some(address) = &args.mavlink {
        let own = links.mavlink.get_or_insert_default();
        address.iter().for_each(|a| own.address.clone_from(a));
    }
    if let Some(address) = &args.natnet {
        let own = links.natnet.get_or_insert_default();
        address.iter().for_each(|a| own.address.clone_from(a));
    }
    if let Some(address) = &args.vrpn {
        let own = links.vrpn.get_or_insert_default();
        address.iter().for_each(|a| own.address.clone_from(a));
    }
    if let Some(address) = &args.lines {
        let own = links.json.get_or_insert_default();
        address.iter().for_each(|a| own.tcp.clone_from(a));
    }
    if let Some(endpoint) = &args.zenoh {
        let own = links.zenoh.get_or_insert_default();
        endpoint.iter().for_each(|e| own.listen = vec![e.clone()]);
    }
    links
}

/// Opens them all, each as a listener with a queue of its own.
pub(super) fn add_links(
    all: &mut Listeners,
    vehicle: &Vehicle,
    session: &LiveSection,
    args: &Live,
) -> Result<()> {
    let marker = |m: &mavsight_flight::Marker| MarkerView {
        name: m.name.clone(),
        rgb: m.color.rgb(),
        in_body_m: m.position_m,
        diameter_m: m.diameter_m,
    };
    let body = Body::new(&vehicle.name, vehicle.marker.iter().map(marker).collect());
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
    /// The last fault, which is reported once.
    said: Option<String>,
}

impl Link {
    fn report(&mut self, fault: Option<String>) {
        if let Some(fault) = fault.filter(|f| self.said.as_ref() != Some(f)) {
            eprintln!("mavsight: {fault}");
            self.said = Some(fault);
        }
    }
}

impl Listener for Link {
    fn fix(&mut self, fix: &Fix) {
        let fault = self.outlet.send(fix).err().map(|e| e.to_string());
        self.report(fault);
    }

    fn event(&mut self, event: &Event) {
        let fault = self.outlet.event(event).err().map(|e| e.to_string());
        self.report(fault);
    }

    fn wants_events(&self) -> bool {
        true
    }
}
