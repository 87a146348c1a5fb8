//! A 1080p frame with a ±2 window, steady state: one encode and one denoise a frame, no files.
//!
//!     cargo bench --bench denoise -- [columns rows [window [frames]]] [weights.safetensors]
//!
//! Predicted and measured numbers stand in benches/NOTES.md.

use std::time::Instant;

use hush::{Engine, Frame, Settings};
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

fn main() {
    let mut args = std::env::args().skip(1).filter_map(|a| a.parse::<usize>().ok());
    let mut next = |default| args.next().unwrap_or(default);
    let (columns, rows, window, frames) = (next(1920), next(1080), next(2), next(3));
    let weights = std::env::args().skip(1).find(|a| a.ends_with(".safetensors"));
    let settings = Settings::default();
    let engine = weights.map_or_else(|| Engine::new(settings.clone()), |path| Engine::from_file(path.as_ref(), settings.clone()));
    let engine = engine.expect("the model loads");
    let encoded: Vec<_> = (0..2 * window + 1).map(|t| engine.encode(frame(rows, columns, t)).expect("encodes")).collect();
    let neighbours: Vec<_> =
        (0..encoded.len()).filter(|t| *t != window).map(|t| (t as i32 - window as i32, &encoded[t])).collect();
    let mut times = Vec::new();
    for t in 0..frames + 1 {
        let frame = frame(rows, columns, t);
        let (start, cpu) = (Instant::now(), cpu_seconds());
        let _new = engine.encode(frame).expect("encodes");
        let encoded_at = start.elapsed();
        let denoised = engine.denoise(&encoded[window], &neighbours, 1.0).expect("denoises");
        let (total, cpu) = (start.elapsed(), cpu_seconds() - cpu);
        assert!(denoised.colour.iter().all(|v| v.is_finite()));
        if t > 0 {
            times.push((total.as_secs_f64(), encoded_at.as_secs_f64(), cpu));
        }
    }
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (total, encode, cpu) = times[times.len() / 2];
    let held: usize = encoded.iter().map(|e| e.bytes()).sum();
    println!(
        "{columns}x{rows} window {window} threads {}: {:.0} ms/frame, of which encode {:.0} ms, processor time {:.0} ms; window holds {} MiB",
        rayon::current_num_threads(),
        total * 1e3,
        encode * 1e3,
        cpu * 1e3,
        held >> 20
    );
    let seconds = engine.stage_seconds();
    let each = hush::engine::STAGES
        .iter()
        .zip(seconds)
        .map(|(stage, s)| format!("{} {:.0}", stage.name(), s * 1e3 / (frames + 1) as f64));
    println!("ms a frame: {}", each.collect::<Vec<_>>().join(", "));
}
