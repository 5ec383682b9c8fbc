//! Progress on standard error.

use indicatif::{ProgressBar, ProgressStyle};
use mavsight_pipeline::{Progress, Stage};
use std::sync::Mutex;
use std::time::Duration;

const TICK: Duration = Duration::from_millis(150);

/// A bar a stage; silent where standard error is not a terminal, except for warnings.
pub(crate) struct Bars(Mutex<ProgressBar>);

impl Bars {
    pub(crate) fn new() -> Self {
        Self(Mutex::new(ProgressBar::hidden()))
    }

    pub(crate) fn start(&self, title: &str, steps: Option<u64>) {
        let bar = match steps {
            Some(n) => {
                ProgressBar::new(n).with_style(style("{msg:<12} {bar:32} {pos}/{len} {elapsed}, {eta} left"))
            }
            None => ProgressBar::new_spinner().with_style(style("{msg:<12} {spinner} {elapsed}")),
        };
        bar.set_message(title.to_owned());
        bar.enable_steady_tick(TICK);
        let mut current = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        current.finish_and_clear();
        *current = bar;
    }

    pub(crate) fn done(&self) {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).finish_and_clear();
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

impl Progress for Bars {
    fn begin(&self, stage: Stage, steps: Option<u64>) {
        let title = match stage {
            Stage::Calibrate => "calibrating",
            Stage::Track => "tracking",
            Stage::Smooth => "smoothing",
            Stage::Identify => "identifying",
        };
        self.start(title, steps);
    }

    fn step(&self) {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).inc(1);
    }
}
