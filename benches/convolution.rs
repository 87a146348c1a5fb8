//! Speed of the network's convolutions at 1080p, for each instruction set and number of threads.
//!
//!     cargo bench --bench convolution [-- FILTER]
//!
//! Compares with the last run; FILTER picks layers by name. The time is that of all threads together (Linux), which holds on a shared
//! machine where wall time does not.
//!
//! Predicted: a 3×3 layer does 9·co/4 FLOPs a byte of input and output (co = ci), 72 at 32 channels; a 1×1 layer 80→48 does
//! 15. One core at 230 GFLOPS and 15 GB/s turns over at 15 FLOPs a byte, so every 3×3 layer is bound by the FMA units and
//! the 1×1 layers stand on the edge. AVX-512 does 64 FLOPs a cycle (Zen 5), AVX2 half, SSE2 without FMA a quarter at most.
//! What was measured: NOTES.md.

use std::time::{Duration, Instant};

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use hush::engine::Isa;
use hush::internals::{Activation, Conv, Epilogue, Winograd};
use ndarray::{Array1, Array4};

/// Channels in and out, kernel size, stride, and the input's rows and columns.
const LAYERS: [(usize, usize, usize, usize, usize, usize); 8] = [
    (40, 32, 3, 1, 540, 960),
    (32, 32, 3, 1, 540, 960),
    (48, 48, 3, 1, 540, 960),
    (48, 80, 3, 2, 540, 960),
    (80, 80, 3, 1, 270, 480),
    (96, 96, 3, 1, 135, 240),
    (80, 48, 1, 1, 540, 960),
    (128, 48, 1, 1, 540, 960),
];

/// The clock of CPU time ticks in milliseconds: a tenth of this, one sample, is good to some percent.
const TIME: Duration = Duration::from_secs(2);
const WARM_UP: Duration = Duration::from_millis(300);

fn convolutions(criterion: &mut Criterion) {
    for (inputs, outputs, kernel, stride, rows, columns) in LAYERS {
        let name = format!("{kernel}x{kernel}/{stride} {inputs}-{outputs} {rows}x{columns}");
        let weight = Array4::from_shape_fn((outputs, inputs, kernel, kernel), |(a, b, c, d)| {
            ((a * 7 + b * 5 + c * 3 + d) % 11) as f32 * 0.01 - 0.05
        });
        let bias = Array1::from_elem(outputs, 0.1);
        let conv = Conv::new(weight.view(), Some(bias.view()), stride);
        let mut input = Activation::new(rows, columns, inputs);
        input.as_mut_slice().iter_mut().enumerate().for_each(|(i, v)| *v = (i % 13) as f32 * 0.1 - 0.6);
        let (out_rows, out_columns) = conv.output_size(rows, columns);
        let flops = 2.0 * (out_rows * out_columns * outputs * inputs * kernel * kernel) as f64;
        let epilogue = Epilogue { relu_input: kernel == 3, ..Epilogue::default() };
        measure(criterion, &name, flops, |isa, output| conv.run(isa, &input, output, epilogue));
        if kernel == 3 && stride == 1 && inputs == outputs {
            let winograd = Winograd::new(weight.view(), bias.view());
            measure(criterion, &format!("winograd {inputs} {rows}x{columns}"), flops, |isa, output| {
                winograd.run(isa, &input, output, epilogue)
            });
        }
    }
}

/// Measures each instruction set and number of threads. What counts is the time of all threads together, so that elements a second are
/// the floating-point operations of a core, those of the plain sum.
fn measure(criterion: &mut Criterion, name: &str, flops: f64, run: impl Fn(Isa, &mut Activation) + Sync) {
    let mut group = criterion.benchmark_group(name);
    group.throughput(Throughput::Elements(flops as u64)).sampling_mode(SamplingMode::Flat);
    group.sample_size(10).warm_up_time(WARM_UP).measurement_time(TIME);
    let mut output = Activation::empty();
    for isa in Isa::available().into_iter().rev() {
        for threads in 1..=std::thread::available_parallelism().map_or(1, usize::from).min(2) {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
            group.bench_function(format!("{}, threads {threads}", isa.name()), |bencher| {
                bencher.iter_custom(|iterations| {
                    let (start, before) = (Instant::now(), cpu_time(&pool));
                    (0..iterations).for_each(|_| pool.install(|| run(isa, &mut output)));
                    // Where the system does not tell, wall time of each thread.
                    cpu_time(&pool).zip(before).map_or(start.elapsed() * threads as u32, |(after, before)| after - before)
                });
            });
        }
    }
    group.finish();
}

/// CPU time that the pool's threads have used so far; None where the system does not tell.
fn cpu_time(pool: &rayon::ThreadPool) -> Option<Duration> {
    let times = pool.broadcast(|_| {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        text.split_whitespace().next()?.parse::<u64>().ok()
    });
    times.into_iter().sum::<Option<u64>>().map(Duration::from_nanos)
}

criterion_group!(benches, convolutions);
criterion_main!(benches);
