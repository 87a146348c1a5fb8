//! Damaged, cut, lying and foreign files: an error with a reason, never a panic, never a huge allocation, never half an output.

mod exr_support;

use std::path::Path;
use std::time::{Duration, Instant};

use exr::prelude::{Compression, SampleType};
use exr_support::*;
use hush::Denoised;
use hush::io::{Selection, WriteOptions, inspect, is_complete, read_frame, read_layout, resolve, write_denoised};

/// The whole way of a file, with a stand-in for the engine.
fn whole_way(source: &Path, output: &Path) -> hush::Result<()> {
    let layout = read_layout(source)?;
    let resolved = resolve(&layout, &Selection::default())?;
    let frame = read_frame(&layout, &resolved)?;
    let denoised = Denoised { colour: frame.colour, alpha: frame.alpha, aovs: frame.aovs };
    write_denoised(&layout, &resolved, &denoised, &WriteOptions { keep_noisy: true, ..WriteOptions::default() }, output)
}

/// Small files of each codec, single- and multi-part.
fn specimens() -> Vec<(String, Vec<u8>)> {
    let mut all = Vec::new();
    for compression in LOSSLESS.into_iter().chain(LOSSY) {
        for multipart in [false, true] {
            let (_folder, source, _) = folder();
            let mut style = Style::new(compression);
            style.size = (9, 35);
            write(&source, render(SampleType::F16, multipart, style.size), style);
            all.push((format!("{compression:?} multipart {multipart}"), std::fs::read(&source).unwrap()));
        }
    }
    all
}

#[test]
fn files_cut_short_are_errors() {
    let (folder, source, output) = folder();
    let mut random = Random(1);
    for (what, bytes) in specimens() {
        let mut cuts = vec![0, 1, 3, 4, 8, 20, bytes.len() - 1, bytes.len() - 2];
        cuts.extend((0..14).map(|_| random.next() as usize % bytes.len()));
        for cut in cuts {
            std::fs::write(&source, &bytes[..cut]).unwrap();
            assert!(whole_way(&source, &output).is_err(), "{what} cut to {cut}");
            assert!(is_complete(&source).is_err(), "{what} cut to {cut}");
            assert!(inspect(&source).is_err(), "{what} cut to {cut}");
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "{what} cut to {cut} left something behind");
        }
    }
}

#[test]
fn mutated_files_give_a_file_or_an_error() {
    let (folder, source, output) = folder();
    let mut random = Random(2);
    let mut outcomes = [0, 0];
    for (what, bytes) in specimens() {
        for round in 0..20 {
            let mut mutated = bytes.clone();
            // Half of the rounds aim at the header, where a byte does most harm.
            let reach = if round % 2 == 0 { mutated.len() } else { mutated.len().min(3000) };
            for _ in 0..1 + random.next() % 6 {
                let at = random.next() as usize % reach;
                mutated[at] = match random.next() % 4 {
                    0 => 0xff,
                    1 => 0,
                    2 => mutated[at] ^ (1 << (random.next() % 8)),
                    _ => random.next() as u8,
                };
            }
            std::fs::write(&source, &mutated).unwrap();
            let result = std::panic::catch_unwind(|| whole_way(&source, &output));
            let Ok(result) = result else { panic!("{what}, round {round}: panicked") };
            outcomes[usize::from(result.is_err())] += 1;
            match result {
                Ok(()) => {
                    is_complete(&output).unwrap();
                    std::fs::remove_file(&output).unwrap();
                }
                Err(e) => assert!(e.to_string().contains("in.exr"), "{e}"),
            }
            let _ = std::panic::catch_unwind(|| inspect(&source).map(|i| i.describe())).expect("inspect panicked");
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        }
    }
    assert!(outcomes[0] > 20 && outcomes[1] > 100, "the mutations hit too little or too much: {outcomes:?}");
}

#[test]
fn garbage_is_no_exr_file() {
    let (_folder, source, _) = folder();
    let magic = [0x76, 0x2f, 0x31, 0x01];
    for bytes in [vec![], b"hello".to_vec(), vec![0; 5000], magic.to_vec(), [&magic[..], &[2, 0, 0, 0]].concat(), vec![0xff; 300]]
    {
        std::fs::write(&source, &bytes).unwrap();
        assert!(read_layout(&source).is_err() && is_complete(&source).is_err(), "{} bytes", bytes.len());
    }
    assert!(read_layout(source.parent().unwrap()).is_err());
    assert!(read_layout(Path::new("no such file.exr")).is_err());
}

/// A header of a scan-line image with one channel, followed by `rest` zero bytes.
fn header(window: [i32; 4], compression: u8, flags: u32, channel: &[u8; 16], extra: &[u8], rest: usize) -> Vec<u8> {
    let mut bytes = vec![0x76, 0x2f, 0x31, 0x01];
    bytes.extend((2 | flags).to_le_bytes());
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        bytes.extend([name.as_bytes(), &[0], kind.as_bytes(), &[0], &(value.len() as u32).to_le_bytes(), value].concat());
    };
    let window: Vec<u8> = window.iter().flat_map(|v| v.to_le_bytes()).collect();
    let names = ["B", "G", "R"].map(str::to_owned);
    attribute("channels", "chlist", &channel_list(&names, channel));
    attribute("compression", "compression", &[compression]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1f32.to_le_bytes());
    bytes.extend(extra);
    bytes.extend(vec![0; 1 + rest]);
    bytes
}

fn channel_list(names: &[String], channel: &[u8; 16]) -> Vec<u8> {
    names.iter().flat_map(|n| [n.as_bytes(), &[0], channel].concat()).chain([0]).collect()
}

const FLOAT: [u8; 16] = [2, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0];
const HALF_SAMPLED: [u8; 16] = [2, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0];

/// What other programs write rightly, and what is said of it.
const KINDS: [(&str, &str); 7] = [
    ("subsampled", "has subsampled channels, as luminance and chroma are kept, which Hush does not read: save it as RGB"),
    ("HTJ2K", "is compressed with HTJ2K, which Hush does not read: save it with ZIP"),
    ("LJ2K", "is compressed with LJ2K"),
    ("ZSTD", "is compressed with ZSTD"),
    ("unknown compression", "is compressed with method 77 of the format, which Hush does not read: save it with ZIP"),
    ("deep", "holds deep data, which Hush does not denoise: save it flattened"),
    ("mipmaps", "has mipmap levels, which Hush does not read: save it with one level"),
];

#[cfg(unix)]
#[test]
fn a_pipe_is_refused_and_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame_0001.exr");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let (tell, told) = std::sync::mpsc::channel();
    std::thread::spawn(move || tell.send(read_layout(&path).unwrap_err().to_string()));
    let error = told.recv_timeout(std::time::Duration::from_secs(20)).expect("it waits for a writer");
    assert!(error.ends_with("frame_0001.exr: is not a file"), "{error}");
}

#[test]
fn a_folder_is_called_one() {
    let folder = tempfile::tempdir().unwrap();
    let error = read_layout(folder.path()).unwrap_err().to_string();
    assert!(error.ends_with("is a folder: name a file in it"), "{error}");
}

#[test]
fn bombs_and_lies_are_refused_at_once() {
    let (_folder, source, _) = folder();
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("65536²", header([0, 0, 65535, 65535], 3, 0, &FLOAT, &[], 0)),
        ("16384² in few bytes", header([0, 0, 16383, 16383], 9, 0, &FLOAT, &[], 600)),
        ("one endless row", header([0, 0, i32::MAX - 1, 0], 3, 0, &FLOAT, &[], 64)),
        ("whole plane", header([i32::MIN, i32::MIN, i32::MAX, i32::MAX], 3, 0, &FLOAT, &[], 64)),
        ("one endless column", header([0, i32::MIN, 0, i32::MAX], 0, 0, &FLOAT, &[], 64)),
        ("inverted window", header([10, 10, 0, 0], 3, 0, &FLOAT, &[], 64)),
        ("empty window", header([0, 0, -1, -1], 3, 0, &FLOAT, &[], 64)),
        ("subsampled", header([0, 0, 31, 31], 3, 0, &HALF_SAMPLED, &[], 64)),
        ("zero sampling", header([0, 0, 31, 31], 3, 0, &[2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], &[], 64)),
        ("HTJ2K", header([0, 0, 31, 31], 10, 0, &FLOAT, &[], 64)),
        ("LJ2K", header([0, 0, 31, 31], 12, 0, &FLOAT, &[], 64)),
        ("ZSTD", header([0, 0, 31, 31], 13, 0, &FLOAT, &[], 64)),
        ("unknown compression", header([0, 0, 31, 31], 77, 0, &FLOAT, &[], 64)),
        ("deep", header([0, 0, 31, 31], 3, 1 << 11, &FLOAT, b"type\0string\0\x0c\0\0\0deepscanline", 64)),
        ("tiled without tiles", header([0, 0, 31, 31], 3, 1 << 9, &FLOAT, &[], 64)),
        ("zero tiles", header([0, 0, 31, 31], 3, 1 << 9, &FLOAT, b"tiles\0tiledesc\0\x09\0\0\0\0\0\0\0\0\0\0\0\0", 64)),
        ("mipmaps", header([0, 0, 31, 31], 3, 1 << 9, &FLOAT, b"tiles\0tiledesc\0\x09\0\0\0\x10\0\0\0\x10\0\0\0\x01", 640)),
        ("future version", header([0, 0, 31, 31], 3, 1 << 20, &FLOAT, &[], 64)),
        ("chunk count", header([0, 0, 31, 31], 3, 0, &FLOAT, b"chunkCount\0int\0\x04\0\0\0\xff\xff\xff\x7f", 64)),
    ];
    let started = Instant::now();
    for (what, bytes) in cases {
        std::fs::write(&source, &bytes).unwrap();
        let error = read_layout(&source).expect_err(what).to_string();
        assert!(error.contains("in.exr"), "{what}: {error}");
        let told = KINDS.iter().find(|(kind, _)| *kind == what).map_or("", |(_, told)| told);
        assert!(error.contains(told), "{what}: {error}");
    }
    assert!(started.elapsed() < Duration::from_secs(2));
    // The same header with a true size is fine, so the refusals above have the reasons that they claim.
    std::fs::write(&source, header([0, 0, 31, 31], 3, 0, &FLOAT, &[], 64)).unwrap();
    read_layout(&source).unwrap();
}

#[test]
fn headers_of_endless_lists_are_refused_at_once() {
    let (_folder, source, _) = folder();
    let plain = |extra: &[u8]| header([0, 0, 31, 31], 3, 0, &FLOAT, extra, 64);
    let attributes =
        |count: usize| (0..count).flat_map(|i| format!("a{i:07}\0int\0\x04\0\0\0\0\0\0\0").into_bytes()).collect::<Vec<u8>>();
    // A second list, which is the one that a careless reader takes.
    let channels = |count: usize| {
        let list = channel_list(&(0..count).map(|i| format!("c{i:07}.R")).collect::<Vec<_>>(), &FLOAT);
        [b"channels\0chlist\0".as_slice(), &(list.len() as u32).to_le_bytes(), &list].concat()
    };
    let parts = |count: usize| {
        let one = plain(&[]);
        let (front, header) = (&one[..8], &one[8..one.len() - 64]);
        let flags = [front[0], front[1], front[2], front[3], 2, 1 << 4, 0, 0];
        [flags.as_slice(), &header.repeat(count), &[0; 65]].concat()
    };
    let cases = [("attributes", plain(&attributes(400_000))), ("channels", plain(&channels(60_000))), ("parts", parts(3000))];
    for (what, bytes) in cases {
        std::fs::write(&source, &bytes).unwrap();
        let started = Instant::now();
        let error = read_layout(&source).expect_err(what).to_string();
        assert!(error.contains("has more than") && error.contains(what), "{what}: {error}");
        assert!(started.elapsed() < Duration::from_secs(2), "{what}: {:?}", started.elapsed());
    }
    // As much as a file with all passes of many view layers may have.
    std::fs::write(&source, plain(&attributes(20_000))).unwrap();
    read_layout(&source).unwrap();
}

#[test]
fn unfinished_files_say_so() {
    let (_folder, source, _) = folder();
    std::fs::write(&source, header([0, 0, 31, 31], 3, 0, &FLOAT, &[], 64)).unwrap();
    let layout = read_layout(&source).unwrap();
    let resolved = resolve(&layout, &Selection::default()).unwrap();
    assert!(read_frame(&layout, &resolved).unwrap_err().to_string().contains("not finished"));
    assert!(is_complete(&source).unwrap_err().to_string().contains("not finished"));
}

#[test]
fn dwa_chunks_cannot_claim_more_than_their_pixels() {
    let (_folder, source, _) = folder();
    write(&source, render(SampleType::F16, false, SIZE), Style::new(Compression::DWAA(None)));
    let bytes = std::fs::read(&source).unwrap();
    let layout = read_layout(&source).unwrap();
    let resolved = resolve(&layout, &Selection::default()).unwrap();
    // Position and size of the chunk and the version of its data stand in front of the claims.
    let claims = first_chunk(&bytes) + 16;
    let mut refused = 0;
    for field in 0..9 {
        let mut bomb = bytes.clone();
        bomb[claims + field * 8..claims + field * 8 + 8].copy_from_slice(&(u64::MAX >> 8).to_le_bytes());
        std::fs::write(&source, &bomb).unwrap();
        refused += usize::from(read_frame(&layout, &resolved).is_err());
    }
    assert_eq!(refused, 9);
}

/// Where the first chunk begins: the smallest position of the chunk table, found by its own place in front of it.
fn first_chunk(bytes: &[u8]) -> usize {
    let entries = SIZE.1.div_ceil(32);
    let is_table = |at: usize| bytes[at..at + 8] == ((at + entries * 8) as u64).to_le_bytes();
    let table = (8..bytes.len() - entries * 8).find(|&at| is_table(at)).unwrap();
    table + entries * 8
}

#[test]
fn a_layout_of_another_file_is_refused() {
    let (folder, source, output) = folder();
    let other = folder.path().join("other.exr");
    write(&source, render(SampleType::F16, false, SIZE), Style::new(Compression::ZIP16));
    let mut parts = render(SampleType::F16, false, SIZE);
    parts[0].channels.extend(pass("A layer in front.Combined", "RGBA", SampleType::F16, SIZE, 3));
    write(&other, parts, Style::new(Compression::ZIP16));
    let layout = read_layout(&source).unwrap();
    let foreign = resolve(&read_layout(&other).unwrap(), &Selection::default()).unwrap();
    assert_eq!(foreign.layer, "ViewLayer");
    assert!(read_frame(&layout, &foreign).is_err());
    let resolved = resolve(&layout, &Selection::default()).unwrap();
    let frame = read_frame(&layout, &resolved).unwrap();
    let denoised = Denoised { colour: frame.colour, alpha: frame.alpha, aovs: vec![] };
    assert!(write_denoised(&layout, &foreign, &denoised, &WriteOptions::default(), &output).is_err());
    // The file changes between reading and writing.
    std::fs::copy(&other, &source).unwrap();
    assert!(write_denoised(&layout, &resolved, &denoised, &WriteOptions::default(), &output).is_err());
    assert!(!output.exists());
}
