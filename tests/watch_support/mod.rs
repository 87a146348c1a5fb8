//! `hush watch` as a process whose events can be waited for.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::common::{Look, write_frame};

/// How long a test waits for anything.
const PATIENCE: Duration = Duration::from_secs(60);

/// A scratch folder with `in/` in it; outputs go to `out/`.
pub struct Scene {
    pub dir: tempfile::TempDir,
}

impl Scene {
    pub fn new() -> Self {
        let scene = Self { dir: tempfile::tempdir().unwrap() };
        std::fs::create_dir(scene.path("in")).unwrap();
        scene
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// The path of an input frame.
    pub fn input(&self, number: i64) -> PathBuf {
        self.path("in").join(crate::common::name(number))
    }

    /// Writes an input frame at once.
    pub fn land(&self, number: i64) {
        write_frame(&self.input(number), number, Look::default());
    }

    /// The bytes of a frame with other noise than its number gives.
    pub fn bytes(&self, seed: u32) -> Vec<u8> {
        let path = self.path("aside.exr");
        write_frame(&path, 0, Look { seed: Some(seed), ..Look::default() });
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        bytes
    }

    /// Starts `hush watch in --output out --json` with more arguments.
    pub fn watch(&self, more: &[&str]) -> Watch {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hush"));
        command.current_dir(self.dir.path()).args(["watch", "in", "--output", "out", "--json"]).args(more);
        Watch::start(command)
    }

    /// Names in a folder, hidden ones too, without the manifest.
    pub fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(folder)).into_iter().flatten();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.retain(|n| n != hush::shot::MANIFEST);
        names.sort();
        names
    }

    /// The outputs have the bytes of a plain run over the same folder, and nothing else lies there.
    pub fn assert_like_a_plain_run(&self, input: &str, output: &str) {
        let plain = self.path("plain").join(input);
        let run = Command::new(env!("CARGO_BIN_EXE_hush"))
            .args(["denoise", "--quiet", "--output"])
            .args([&plain, &self.path(input)])
            .output()
            .unwrap();
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        let names = self.names(&format!("plain/{input}"));
        assert_eq!(self.names(output), names);
        for name in names {
            let same = std::fs::read(plain.join(&name)).unwrap() == std::fs::read(self.path(output).join(&name)).unwrap();
            assert!(same, "{name} differs from a plain run's");
        }
        std::fs::remove_dir_all(plain).unwrap();
    }
}

/// Writes a file in place, piece by piece.
pub fn write_slowly(path: &Path, bytes: &[u8], pieces: usize, pause: Duration) {
    let mut file = std::fs::File::create(path).unwrap();
    for piece in bytes.chunks(bytes.len().div_ceil(pieces)) {
        file.write_all(piece).unwrap();
        file.flush().unwrap();
        std::thread::sleep(pause);
    }
}

/// A running watch.
pub struct Watch {
    pub child: Child,
    events: Arc<Mutex<Vec<Value>>>,
    reader: Option<std::thread::JoinHandle<()>>,
}

impl Watch {
    pub fn start(mut command: Command) -> Self {
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().unwrap();
        let events = Arc::new(Mutex::new(Vec::new()));
        let (out, into) = (child.stdout.take().unwrap(), events.clone());
        let reader = std::thread::spawn(move || {
            for line in BufReader::new(out).lines().map_while(Result::ok) {
                into.lock().unwrap().push(serde_json::from_str(&line).unwrap_or_else(|e| panic!("{line}: {e}")));
            }
        });
        Self { child, events, reader: Some(reader) }
    }

    pub fn events(&self) -> Vec<Value> {
        self.events.lock().unwrap().clone()
    }

    pub fn named(&self, name: &str) -> Vec<Value> {
        self.events().into_iter().filter(|e| e["event"] == name).collect()
    }

    /// Frames that were denoised, in that order.
    pub fn denoised(&self) -> Vec<i64> {
        self.named("frame").iter().filter(|e| e["status"] == "denoised").map(|e| e["frame"].as_i64().unwrap()).collect()
    }

    /// Waits for a state.
    pub fn until(&mut self, what: &str, reached: impl Fn(&Self) -> bool) {
        let began = Instant::now();
        while !reached(self) {
            assert!(self.child.try_wait().unwrap().is_none(), "ended before {what}: {:#?}", self.events());
            assert!(began.elapsed() < PATIENCE, "{what} did not come: {:#?}", self.events());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits until that many frames have landed and all are denoised.
    pub fn until_done(&mut self, frames: usize) {
        self.until(&format!("{frames} frames"), |w| w.is_done(frames));
    }

    /// Whether that many frames have landed and all are denoised.
    pub fn is_done(&self, frames: usize) -> bool {
        let events = self.events();
        let Some(last) = events.iter().rfind(|e| e["event"] == "waiting" || e["event"] == "landed") else { return false };
        last["event"] == "waiting"
            && last["denoised"] == frames
            && last["landed"] == frames
            && ["waiting", "incomplete", "elsewhere", "failed"].iter().all(|k| last[k] == 0)
    }

    pub fn signal(&self, signal: &str) {
        assert!(Command::new("kill").args([signal, &self.child.id().to_string()]).status().unwrap().success());
    }

    /// Waits for the end; the exit code and the last event.
    pub fn end(&mut self) -> (Option<i32>, Value) {
        let code = self.child.wait().unwrap().code();
        if let Some(reader) = self.reader.take() {
            reader.join().unwrap();
        }
        (code, self.events().last().cloned().unwrap_or_default())
    }

    /// Waits until it ends by itself; the exit code and the last event.
    pub fn end_by_itself(&mut self) -> (Option<i32>, Value) {
        let began = Instant::now();
        while self.child.try_wait().unwrap().is_none() {
            assert!(began.elapsed() < PATIENCE, "it does not end: {:#?}", self.events());
            std::thread::sleep(Duration::from_millis(20));
        }
        self.end()
    }

    /// Waits until it ends by itself with every frame done; the last event.
    pub fn finish(&mut self, frames: usize) -> Value {
        let (code, last) = self.end_by_itself();
        assert_eq!((code, &last["event"]), (Some(0), &"done".into()), "{:#?}", self.events());
        assert!(last["written"].as_u64() >= Some(1) || last["skipped"] == frames, "{last}");
        assert_eq!((&last["frames"], &last["missing"], &last["interrupted"]), (&frames.into(), &"".into(), &false.into()));
        last
    }

    /// Stops it as a farm would.
    pub fn stop(mut self) -> Value {
        self.signal("-TERM");
        let (code, last) = self.end();
        assert_eq!(code, Some(130), "{last}");
        last
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
