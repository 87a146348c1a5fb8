//! The threads beside the engine: one decodes frames ahead, one writes them behind.

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, SyncSender};

use super::file_state::FileState;
use super::planned_frame::PlannedFrame;
use super::prepare::Plan;
use crate::engine::{Denoised, Engine};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::io::{Resolved, WriteOptions, write_views};
use crate::rules::pixel_checks::Glance;

/// A frame on its way through the decoder.
pub(super) struct Decoded {
    pub number: i64,
    pub frame: Result<(Vec<Frame>, Glance)>,
    /// The file which was read or is damaged, with its content; None where it cannot be read or changed since the plan was made.
    pub state: Option<FileState>,
}

/// A frame on its way to the writer.
pub(super) struct Work {
    pub index: usize,
    /// One a view.
    pub denoised: Vec<Denoised>,
    pub seconds: f64,
}

/// A frame back from the writer.
pub(super) struct Written {
    pub index: usize,
    /// The file as it was written.
    pub result: Result<Option<FileState>>,
    pub seconds: f64,
}

/// The decoder thread; ends when nobody takes its frames any more.
pub(super) fn decode(order: &[i64], plan: &Plan, engine: &Engine, to: SyncSender<Decoded>) {
    for &number in order {
        let Some(source) = plan.sources.good.get(&number) else { return };
        let frame = engine.in_pool(|| source.read()).and_then(|views| {
            let first = views.first().ok_or_else(|| Error::bad_file(&source.path, "holds no image"))?;
            let glance = Glance::of(first);
            Ok((views, glance))
        });
        let sound = frame.as_ref().map(drop);
        let state = state_of(&source.path, sound, plan.sources.stamp(number));
        if to.send(Decoded { number, frame, state }).is_err() {
            return;
        }
    }
}

/// A file that is still as it was planned, with its content, if it was read or is to blame for that it was not.
pub(super) fn state_of(path: &Path, read: Result<(), &Error>, planned: Option<FileState>) -> Option<FileState> {
    match read {
        Err(Error::Io { .. }) => None,
        _ => FileState::read(path).filter(|state| planned.is_some_and(|planned| state.is_untouched_since(&planned))),
    }
}

/// The writer thread; ends with its input. After a full disk it takes frames no more.
pub(super) fn write(plan: &Plan, keep_noisy: bool, engine: &Engine, from: &Receiver<Work>, to: &Sender<Written>) {
    for Work { index, denoised, seconds } in from {
        let Some(frame) = plan.frames.get(index) else { return };
        let Some(source) = plan.sources.good.get(&frame.frame) else { return };
        let views: Vec<(&Resolved, &Denoised)> = source.views.iter().zip(&denoised).collect();
        let options = WriteOptions { keep_noisy, attributes: vec![("hush".into(), made_by(plan, frame))] };
        let result = engine
            .in_pool(|| write_views(&source.layout, &views, &options, &frame.output))
            .map(|()| FileState::read(&frame.output));
        let over = result.as_ref().err().is_some_and(|e| frame.output.parent().is_some_and(|folder| ends_the_run(e, folder)));
        if to.send(Written { index, result, seconds }).is_err() || over {
            return;
        }
    }
}

/// The attribute `hush` of an output.
fn made_by(plan: &Plan, frame: &PlannedFrame) -> String {
    let (window, engine) = (plan.settings.window, &plan.settings.engine);
    let model = &engine.model.name;
    let renderer = engine.renderer.as_ref().map_or(String::new(), |name| format!(", renderer {name}"));
    let masked = frame.lambda_masked.map_or(String::new(), |lambda| format!(", lambda masked {lambda}"));
    format!("hush {}, lambda {}{masked}, window {window}, model {model}{renderer}", env!("CARGO_PKG_VERSION"), frame.lambda)
}

/// Whether an error is about the output folder itself, so that every further frame would meet it too.
pub(super) fn ends_the_run(error: &Error, output: &Path) -> bool {
    use std::io::ErrorKind::{
        FileTooLarge, NotADirectory, NotFound, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull,
    };
    match error {
        Error::Io { path, source } => {
            let kinds = [StorageFull, QuotaExceeded, FileTooLarge, ReadOnlyFilesystem, PermissionDenied, NotFound, NotADirectory];
            path.starts_with(output) && kinds.contains(&source.kind())
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use std::io::ErrorKind;

    use super::*;

    #[test]
    fn only_errors_of_the_output_folder_end_the_run() {
        let out = Path::new("out");
        let error = |path: &str, kind: ErrorKind| Error::io(path, kind.into());
        for kind in [ErrorKind::StorageFull, ErrorKind::QuotaExceeded, ErrorKind::PermissionDenied, ErrorKind::NotFound] {
            assert!(ends_the_run(&error("out/f_0001.exr", kind), out), "{kind}");
            assert!(!ends_the_run(&error("shot/f_0001.exr", kind), out), "{kind}");
        }
        assert!(!ends_the_run(&error("out/f_0001.exr", ErrorKind::Interrupted), out));
        assert!(!ends_the_run(&Error::bad_file("out/f_0001.exr", "is damaged"), out));
    }
}
