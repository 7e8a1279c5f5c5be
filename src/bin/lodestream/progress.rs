//! A progress bar for people: stage, throughput, time left. Silent where standard error is no terminal.

use crate::shared;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::sync::Mutex;

/// Shows the stage at hand.
pub struct Bars {
    /// The stage shown and its bar; `None` between stages.
    current: Mutex<Option<(&'static str, ProgressBar)>>,
    visible: bool,
}

impl Bars {
    /// `wanted` is false under `--json`.
    pub fn new(wanted: bool) -> Self {
        Bars { current: Mutex::new(None), visible: wanted && shared::stderr_is_terminal() }
    }

    /// Say where the work stands. May be called from any thread.
    pub fn show(&self, stage: &'static str, done: u64, total: u64) {
        if !self.visible {
            return;
        }
        let mut current = self.current.lock().unwrap_or_else(|broken| broken.into_inner());
        if current.as_ref().is_none_or(|(shown, _)| *shown != stage) {
            if let Some((_, bar)) = current.take() {
                bar.finish_and_clear();
            }
            let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr());
            let unit = match stage {
                "order" => "states",
                "measure" => "levels",
                _ => "vertices",
            };
            let style = format!(
                "{{msg:10}} {{wide_bar:.cyan/blue}} {{human_pos}}/{{human_len}} {unit}, {{speed}}, {{eta}} left"
            );
            // The template is a constant; should it ever be wrong, the default bar still shows.
            let style = ProgressStyle::with_template(&style).unwrap_or_else(|_| ProgressStyle::default_bar());
            bar.set_style(style.with_key("speed", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                // A bar that cannot be written is no reason to stop.
                let _ = write!(out, "{}/s", shared::thousands(state.per_sec() as u64));
            }));
            bar.set_message(stage);
            *current = Some((stage, bar));
        }
        if let Some((_, bar)) = current.as_ref() {
            bar.set_length(total);
            bar.set_position(done);
        }
    }

    /// Clear the line.
    pub fn finish(&self) {
        let mut current = self.current.lock().unwrap_or_else(|broken| broken.into_inner());
        if let Some((_, bar)) = current.take() {
            bar.finish_and_clear();
        }
    }
}
