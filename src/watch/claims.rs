//! Which process denoises which frame, where several watch the same folder, on one machine or on several.
//!
//! A claim is a file `.hush-claims/NAME.claim` in the output folder that only one process can create. Beside the claims each
//! process has a file `TOKEN.alive` that it writes again and again while it holds any. A claim is stale if its process is gone
//! from this machine, or if the alive file has not changed while we looked on; clocks of different machines are not compared.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::host::{host, is_gone};
use crate::error::{Error, Result};
use crate::io::{part_files, part_prefix, process_token};

/// The folder of the claims, in an output folder.
pub(super) const CLAIMS: &str = ".hush-claims";
/// How often a process says that it is alive.
const BEAT: Duration = Duration::from_secs(2);
/// A claim whose process has not said so for this long is stale.
const STALE: Duration = Duration::from_secs(20);

/// Who holds a claim.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Owner {
    /// The machine, for people.
    name: String,
    /// The machine since its start, and the container.
    host: String,
    pid: u32,
    /// Different for each process ever.
    token: String,
    /// What the names of its unfinished files hold; empty in claims of earlier versions.
    #[serde(default)]
    parts: String,
}

/// What an alive file holds.
#[derive(Serialize)]
struct Alive<'a> {
    #[serde(flatten)]
    owner: &'a Owner,
    beat: u64,
}

/// What came of an attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Claim {
    /// The frame is ours.
    Ours,
    /// Another process is at it.
    Theirs,
}

/// The claims of this process.
pub(super) struct Claims {
    owner: Owner,
    /// Its signs of life so far: no two are alike, however often claims were held and given back between two looks at them.
    beats: Arc<AtomicU64>,
    /// What was seen of others, by token or by a claim's path: the last content, and since when.
    watched: BTreeMap<String, (Option<Vec<u8>>, Duration)>,
}

/// Claims held in one folder; given back when dropped.
pub(super) struct Held {
    folder: PathBuf,
    owner: Owner,
    files: Vec<PathBuf>,
    stop: Option<Sender<()>>,
    beat: Option<JoinHandle<()>>,
}

impl Claims {
    /// For this process.
    pub fn new() -> Self {
        let (name, host) = host();
        let pid = std::process::id();
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
        let mixed = std::hash::BuildHasher::hash_one(&std::hash::RandomState::new(), since);
        Self {
            owner: Owner { name, host, pid, token: format!("{mixed:016x}"), parts: process_token() },
            beats: Arc::default(),
            watched: BTreeMap::new(),
        }
    }

    /// Begins to hold claims in an output folder.
    ///
    /// # Errors
    /// The folder cannot be made or written to.
    pub fn open(&self, output: &Path) -> Result<Held> {
        let folder = output.join(CLAIMS);
        fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
        let alive = folder.join(alive_name(&self.owner.token));
        let (owner, beats) = (self.owner.clone(), self.beats.clone());
        let beat = move || {
            let beat = beats.fetch_add(1, Ordering::Relaxed);
            let text = serde_json::to_vec(&Alive { owner: &owner, beat }).unwrap_or_default();
            fs::write(&alive, text).map_err(|e| Error::io(&alive, e))
        };
        beat()?;
        let (stop, stopped) = channel();
        let beats = move || {
            while let Err(RecvTimeoutError::Timeout) = stopped.recv_timeout(BEAT) {
                // A beat that cannot be written is made up for by the next; in the end the claim goes stale.
                let _ = beat();
            }
        };
        let beat = std::thread::spawn(beats);
        Ok(Held { folder, owner: self.owner.clone(), files: Vec::new(), stop: Some(stop), beat: Some(beat) })
    }

    /// Tries to claim an output file.
    ///
    /// # Errors
    /// The claim cannot be written.
    pub fn claim(&mut self, held: &mut Held, file: &str, now: Duration) -> Result<Claim> {
        let path = held.folder.join(format!("{file}.claim"));
        if create(&path, &self.owner)? {
            self.watched.remove(&path.to_string_lossy().into_owned());
            held.files.push(path);
            return Ok(Claim::Ours);
        }
        let before = fs::read(&path).unwrap_or_default();
        if !self.is_stale(&held.folder, &path, &before, now) {
            return Ok(Claim::Theirs);
        }
        // Only one process at a time removes stale claims, and only the very one that it looked at.
        let lock = lock(&held.folder);
        if fs::read(&path).is_ok_and(|content| content == before) {
            let _ = fs::remove_file(&path);
        }
        let ours = create(&path, &self.owner)?;
        drop(lock);
        if ours {
            remove_leftovers(&held.folder, file, &before);
            held.files.push(path);
        }
        Ok(if ours { Claim::Ours } else { Claim::Theirs })
    }

    /// Whether the process that wrote a claim is gone, as far as can be told now.
    fn is_stale(&mut self, folder: &Path, path: &Path, content: &[u8], now: Duration) -> bool {
        let owner: Option<Owner> = serde_json::from_slice(content).ok();
        if owner.as_ref().is_some_and(|o| o.host == self.owner.host && is_gone(o.pid)) {
            return true;
        }
        // A claim that cannot be read is judged by itself.
        let (key, sign) = match &owner {
            Some(o) => (o.token.clone(), fs::read(folder.join(alive_name(&o.token))).ok()),
            None => (path.to_string_lossy().into_owned(), Some(content.to_vec())),
        };
        let (last, since) = self.watched.entry(key).or_insert_with(|| (sign.clone(), now));
        if *last != sign {
            (*last, *since) = (sign, now);
        }
        now.saturating_sub(*since) >= STALE
    }

    /// Removes the claims and alive files that processes of this machine left behind when they were killed.
    pub fn sweep(&self, output: &Path) {
        let folder = output.join(CLAIMS);
        let lock = lock(&folder);
        for path in fs::read_dir(&folder).into_iter().flatten().flatten().map(|e| e.path()) {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let Some(owner) = fs::read(&path).ok().and_then(|c| serde_json::from_slice::<Owner>(&c).ok()) else {
                // Killed as it wrote it; one that lives writes it again.
                if name.ends_with(ALIVE) {
                    let _ = fs::remove_file(&path);
                }
                continue;
            };
            if owner.host == self.owner.host && is_gone(owner.pid) {
                if let Some(file) = name.strip_suffix(".claim") {
                    let content = serde_json::to_vec(&owner).unwrap_or_default();
                    remove_leftovers(&folder, file, &content);
                }
                let _ = fs::remove_file(&path);
            }
        }
        drop(lock);
    }
}

impl Held {
    /// Gives one claim back.
    pub fn release(&mut self, file: &str) {
        let path = self.folder.join(format!("{file}.claim"));
        self.files.retain(|p| *p != path);
        self.remove(&path);
    }

    /// Removes a claim if it still is ours: a process that was stopped for long may have lost it.
    fn remove(&self, path: &Path) {
        let content = fs::read(path).ok().and_then(|c| serde_json::from_slice::<Owner>(&c).ok());
        if content.is_some_and(|o| o == self.owner) {
            let _ = fs::remove_file(path);
        }
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        let lock = lock(&self.folder);
        self.files.iter().for_each(|path| self.remove(path));
        drop(lock);
        drop(self.stop.take());
        if let Some(beat) = self.beat.take() {
            let _ = beat.join();
        }
        let _ = fs::remove_file(self.folder.join(alive_name(&self.owner.token)));
    }
}

/// Removes the claims' folder where nobody has claims.
pub(super) fn tidy(output: &Path) {
    let folder = output.join(CLAIMS);
    let only_lock = fs::read_dir(&folder).is_ok_and(|entries| entries.flatten().all(|e| e.file_name() == LOCK));
    if only_lock {
        let _ = fs::remove_file(folder.join(LOCK));
        let _ = fs::remove_dir(&folder);
    }
}

const LOCK: &str = "lock";
const ALIVE: &str = ".alive";

fn alive_name(token: &str) -> String {
    format!("{token}{ALIVE}")
}

/// Creates a claim; false where there is one.
fn create(path: &Path, owner: &Owner) -> Result<bool> {
    match File::options().write(true).create_new(true).open(path) {
        Ok(mut file) => {
            let text = serde_json::to_vec(owner).map_err(|e| Error::bad_file(path, e.to_string()))?;
            let written = file.write_all(&text);
            if written.is_err() {
                let _ = fs::remove_file(path);
            }
            written.map(|()| true).map_err(|e| Error::io(path, e))
        }
        Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(false),
        Err(e) => Err(Error::io(path, e)),
    }
}

/// A lock that ends with its process; none where the file system has no locks, and then two may rarely do one frame.
fn lock(folder: &Path) -> Option<File> {
    let file = File::options().write(true).create(true).truncate(false).open(folder.join(LOCK)).ok()?;
    file.lock().is_ok().then_some(file)
}

/// Removes what the process that held a claim had not finished writing.
fn remove_leftovers(folder: &Path, file: &str, claim: &[u8]) {
    let Ok(owner) = serde_json::from_slice::<Owner>(claim) else { return };
    let Some(output) = folder.parent() else { return };
    if owner.parts.is_empty() {
        return;
    }
    let prefixes = [file, crate::shot::MANIFEST].map(|name| part_prefix(name, &owner.parts));
    for part in part_files(output) {
        let name = part.file_name().unwrap_or_default().to_string_lossy();
        if prefixes.iter().any(|prefix| name.starts_with(prefix)) {
            let _ = fs::remove_file(&part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn second(n: u64) -> Duration {
        Duration::from_secs(n)
    }

    fn other(name: &str, pid: u32) -> Claims {
        let mut claims = Claims::new();
        (claims.owner.host, claims.owner.pid) = (name.into(), pid);
        claims
    }

    #[test]
    fn a_claim_is_had_by_one_and_given_back() {
        let dir = tempfile::tempdir().unwrap();
        let (mut a, mut b) = (Claims::new(), Claims::new());
        let (mut of_a, mut of_b) = (a.open(dir.path()).unwrap(), b.open(dir.path()).unwrap());
        assert_eq!(a.claim(&mut of_a, "f.exr", second(0)).unwrap(), Claim::Ours);
        assert_eq!(b.claim(&mut of_b, "f.exr", second(100)).unwrap(), Claim::Theirs);
        of_b.release("f.exr");
        assert_eq!(b.claim(&mut of_b, "f.exr", second(100)).unwrap(), Claim::Theirs, "only one's own is given back");
        drop(of_a);
        assert_eq!(b.claim(&mut of_b, "f.exr", second(101)).unwrap(), Claim::Ours);
        drop(of_b);
        tidy(dir.path());
        assert!(!dir.path().join(CLAIMS).exists());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_killed_process_of_this_machine_loses_its_claims_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let mut child = std::process::Command::new("true").spawn().unwrap();
        child.wait().unwrap();
        let mut dead = other(&Claims::new().owner.host, child.id());
        dead.owner.parts = "0123-1".into();
        let mut of_dead = dead.open(dir.path()).unwrap();
        let part = dir.path().join(format!("{}7.part", part_prefix("f.exr", "0123-1")));
        let others = dir.path().join(format!("{}7.part", part_prefix("f.exr", "0123-11")));
        for file in ["f.exr", "g.exr"] {
            dead.claim(&mut of_dead, file, second(0)).unwrap();
        }
        fs::write(&part, b"half").unwrap();
        fs::write(&others, b"half").unwrap();
        let mut b = Claims::new();
        let mut of_b = b.open(dir.path()).unwrap();
        assert_eq!(b.claim(&mut of_b, "f.exr", second(0)).unwrap(), Claim::Ours);
        assert!(!part.exists() && others.exists());
        b.sweep(dir.path());
        let left = |name: &str| dir.path().join(CLAIMS).join(name).exists();
        assert!(left("f.exr.claim") && !left("g.exr.claim"));
        drop(of_dead);
        assert!(left("f.exr.claim"), "the dead one's return takes nothing away");
    }

    #[test]
    fn an_alive_file_cut_short_by_a_kill_does_not_stay() {
        let dir = tempfile::tempdir().unwrap();
        let claims = Claims::new();
        let held = claims.open(dir.path()).unwrap();
        fs::write(dir.path().join(CLAIMS).join(alive_name("0123")), b"").unwrap();
        claims.sweep(dir.path());
        drop(held);
        tidy(dir.path());
        assert!(!dir.path().join(CLAIMS).exists());
    }

    #[test]
    fn another_machine_is_stale_when_its_sign_of_life_stands_still() {
        let dir = tempfile::tempdir().unwrap();
        let mut far = other("elsewhere", 1);
        let mut of_far = far.open(dir.path()).unwrap();
        far.claim(&mut of_far, "f.exr", second(0)).unwrap();
        let alive = dir.path().join(CLAIMS).join(alive_name(&far.owner.token));
        let mut b = Claims::new();
        let mut of_b = b.open(dir.path()).unwrap();
        let mut try_at = |at: u64| b.claim(&mut of_b, "f.exr", second(at)).unwrap();
        // Whatever that machine's clock says, the content is what counts.
        assert_eq!(try_at(0), Claim::Theirs);
        fs::write(&alive, "x").unwrap();
        assert_eq!(try_at(19), Claim::Theirs);
        fs::write(&alive, "y").unwrap();
        assert_eq!(try_at(30), Claim::Theirs);
        // The beats of the thread in this test may come in between; the last state stands.
        drop(of_far.stop.take());
        of_far.beat.take().unwrap().join().unwrap();
        assert_eq!(try_at(31), Claim::Theirs);
        assert_eq!(try_at(49), Claim::Theirs);
        assert_eq!(try_at(52), Claim::Ours);
        assert_eq!(try_at(53), Claim::Theirs, "it is ours already, which is nobody's to claim again");
    }

    #[test]
    fn a_claim_long_after_another_of_the_same_process_is_fresh() {
        let dir = tempfile::tempdir().unwrap();
        let (mut far, mut b) = (other("elsewhere", 1), Claims::new());
        let mut of_b = b.open(dir.path()).unwrap();
        for (file, at) in [("f.exr", 0), ("g.exr", 60)] {
            let mut of_far = far.open(dir.path()).unwrap();
            far.claim(&mut of_far, file, second(at)).unwrap();
            assert_eq!(b.claim(&mut of_b, file, second(at)).unwrap(), Claim::Theirs, "{file}");
        }
    }

    #[test]
    fn a_claim_cut_short_goes_stale_too() {
        let dir = tempfile::tempdir().unwrap();
        let mut b = Claims::new();
        let mut of_b = b.open(dir.path()).unwrap();
        fs::write(dir.path().join(CLAIMS).join("f.exr.claim"), b"{\"na").unwrap();
        assert_eq!(b.claim(&mut of_b, "f.exr", second(0)).unwrap(), Claim::Theirs);
        assert_eq!(b.claim(&mut of_b, "f.exr", second(19)).unwrap(), Claim::Theirs);
        assert_eq!(b.claim(&mut of_b, "f.exr", second(21)).unwrap(), Claim::Ours);
    }

    #[test]
    fn many_at_once_share_without_overlap() {
        let dir = tempfile::tempdir().unwrap();
        let taken: Vec<Vec<usize>> = std::thread::scope(|scope| {
            let worker = || {
                let mut claims = Claims::new();
                let mut held = claims.open(dir.path()).unwrap();
                let mut mine = |i: &usize| claims.claim(&mut held, &i.to_string(), second(0)).unwrap() == Claim::Ours;
                let mine: Vec<usize> = (0..200).filter(|i| mine(i)).collect();
                (mine, held)
            };
            let workers: Vec<_> = (0..4).map(|_| scope.spawn(worker)).collect();
            let results: Vec<_> = workers.into_iter().map(|w| w.join().unwrap()).collect();
            results.into_iter().map(|(mine, _)| mine).collect()
        });
        let mut all = taken.concat();
        all.sort_unstable();
        assert_eq!(all, (0..200).collect::<Vec<_>>());
    }
}
