//! A 1080p frame with a ±2 window, steady state: one encode and one denoise a frame, no files.
//!
//!     cargo bench --bench denoise [-- --save-baseline NAME | --baseline NAME]
//!
//! Compares with the last run, or with the one that has that name. `HUSH_BENCH_COLUMNS`, `HUSH_BENCH_ROWS`, `HUSH_BENCH_WINDOW`,
//! `HUSH_BENCH_MODEL` (a weights file) and `HUSH_BENCH_LAMBDA_MAP` (1: λ for each pixel) change what is measured. Beside OIDN: `python benches/beside_oidn.py`.
//! Predicted and measured numbers stand in benches/NOTES.md.

use std::time::{Duration, Instant};

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use hush::engine::STAGES;
use hush::{Dial, Engine, Frame, LambdaMap, Settings};
use ndarray::{Array2, Array3};

/// A frame with structure, noise and motion, from a hash of the pixel.
fn frame(rows: usize, columns: usize, time: usize) -> Frame {
    let noise = |y: usize, x: usize, c: usize| {
        let h = (y * 7919 + x * 104_729 + c * 1_299_709 + time * 15_485_863) as u32;
        let h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
        ((h ^ (h >> 13)) >> 8) as f32 / 16_777_216.0
    };
    let wave = |y: usize, x: usize| 0.5 + 0.4 * ((x as f32 * 0.02).sin() * (y as f32 * 0.03).cos());
    let mut frame = Frame::new(Array3::from_shape_fn((rows, columns, 3), |(y, x, c)| wave(y, x) * 2.0 * noise(y, x, c)));
    frame.albedo = Some(Array3::from_shape_fn((rows, columns, 3), |(y, x, _)| wave(x, y)));
    frame.normal = Some(Array3::from_shape_fn((rows, columns, 3), |(y, x, c)| if c == 2 { -1.0 } else { wave(y, x) - 0.5 }));
    frame.depth = Some(Array2::from_shape_fn((rows, columns), |(y, x)| 2.0 + wave(y, x)));
    frame.vector = Some(Array3::from_shape_fn((rows, columns, 4), |(y, x, c)| wave(y, x) * [2.5, -1.0, -2.5, 1.0][c]));
    frame
}

/// Processor time of this process in seconds, where the system tells it: what other processes take does not count.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    after_name.split_whitespace().skip(11).take(2).filter_map(|t| t.parse::<f64>().ok()).sum::<f64>() / 100.0
}

/// A number from the environment.
fn setting(name: &str, default: usize) -> usize {
    std::env::var(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}={text} is no number")))
}

fn denoise(criterion: &mut Criterion) {
    let (columns, rows) = (setting("HUSH_BENCH_COLUMNS", 1920), setting("HUSH_BENCH_ROWS", 1080));
    let window = setting("HUSH_BENCH_WINDOW", 2);
    let settings = Settings::default();
    let engine = match std::env::var_os("HUSH_BENCH_MODEL") {
        Some(path) => Engine::from_file(path.as_ref(), settings),
        None => Engine::new(settings),
    };
    let engine = engine.expect("the model loads");
    let encoded: Vec<_> = (0..2 * window + 1).map(|t| engine.encode(frame(rows, columns, t)).expect("encodes")).collect();
    let neighbours: Vec<_> =
        (0..encoded.len()).filter(|t| *t != window).map(|t| (t as i32 - window as i32, &encoded[t])).collect();
    let lambda = Array2::from_shape_fn((rows, columns), |(y, x)| if (y / 90 + x / 160) % 2 == 0 { 1.0 } else { 16.0 });
    let map = (setting("HUSH_BENCH_LAMBDA_MAP", 0) > 0).then(|| LambdaMap::new(lambda.view(), 1.0).expect("a map"));
    let dial = map.as_ref().map_or(Dial::Constant(1.0), Dial::Map);
    let (mut count, mut cpu) = (0, 0.0);
    let mut group = criterion.benchmark_group("denoise");
    group.sampling_mode(SamplingMode::Flat).sample_size(10).warm_up_time(Duration::from_secs(1));
    group.bench_function(format!("{columns}x{rows} window {window}"), |bencher| {
        bencher.iter_custom(|iterations| {
            let mut total = Duration::ZERO;
            for t in 0..iterations {
                let frame = frame(rows, columns, t as usize);
                let (start, cpu_before) = (Instant::now(), cpu_seconds());
                let _new = engine.encode(frame).expect("encodes");
                let denoised = engine.denoise(&encoded[window], &neighbours, dial).expect("denoises");
                total += start.elapsed();
                (count, cpu) = (count + 1, cpu + cpu_seconds() - cpu_before);
                assert!(denoised.colour.iter().all(|v| v.is_finite()));
            }
            total
        });
    });
    group.finish();
    if count > 0 {
        let held: usize = encoded.iter().map(|e| e.bytes()).sum();
        let mean = |seconds: f64| seconds * 1e3 / f64::from(count);
        let each = STAGES.iter().zip(engine.stage_seconds()).map(|(stage, s)| format!("{} {:.0}", stage.name(), mean(s)));
        let each = each.collect::<Vec<_>>().join(", ");
        println!("a frame, ms: processor time {:.0}; {each}; the window holds {} MiB", mean(cpu), held >> 20);
    }
}

criterion_group!(benches, denoise);
criterion_main!(benches);
