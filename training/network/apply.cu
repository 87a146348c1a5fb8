// Kernel application on a GPU, one thread a pixel: model.py's `kernel_average` and its gradient. tap.h goes before it.
// Built and called by cuda.py; the tests build it as C++. All arrays are contiguous f32, rows last but one, columns last.

struct Shape {
    int batch, frames, rows, columns;
    const int *sizes; // width of each frame's kernel
    int coarse; // width of the kernel over the coarser level, 0 without
};

struct Sources {
    const float *logits; // (B, K, H, W)
    const float *images, *valid; // (B, T, 3, H, W) and (B, T, 1, H, W)
    const float *colour, *mask; // of the coarser level, (B, 3, H/2, W/2) and (B, 1, H/2, W/2), or null
    const float *queries, *keys; // (B, T, 2, H, W) and (B, T, 1, H, W), or null
};

struct Tap {
    long long logit; // index of its logit
    const float *source; // red of what it reads
    long long channel; // distance between the channels there
    long long at; // index of red in the array it reads: `images`, or `colour` where `frame` is −1
    float valid, key, moved; // its mask, its key, its logit moved by the key
    int frame;
};

// Calls visit(Tap) for each valid tap of a pixel, in the order of the logits.
template <typename Visit>
__device__ void each_tap(const Shape &s, const Sources &from, int b, int y, int x, Visit visit) {
    const long long plane = (long long)s.rows * s.columns, own = (long long)y * s.columns + x;
    long long taps = s.coarse * s.coarse, logit = own;
    for (int f = 0; f < s.frames; ++f) taps += s.sizes[f] * s.sizes[f];
    logit += b * taps * plane;
    for (int f = 0; f < s.frames; ++f) {
        const int radius = s.sizes[f] / 2;
        const long long frame = (long long)b * s.frames + f;
        const float *query = from.keys ? from.queries + frame * 2 * plane + own : nullptr;
        const float first = query ? query[0] : 0.0f, second = query ? query[plane] : 0.0f;
        for (int dy = -radius; dy <= radius; ++dy)
            for (int dx = -radius; dx <= radius; ++dx, logit += plane) {
                if (y + dy < 0 || y + dy >= s.rows || x + dx < 0 || x + dx >= s.columns) continue;
                const long long there = own + (long long)dy * s.columns + dx, at = frame * 3 * plane + there;
                const float valid = from.valid[frame * plane + there];
                if (valid == 0.0f) continue;
                const float key = from.keys ? from.keys[frame * plane + there] : 0.0f;
                visit(Tap{logit, from.images + at, plane, at, valid, key, keyed(from.logits[logit], key, first, second), f});
            }
    }
    const int radius = s.coarse / 2, rows = s.rows / 2, columns = s.columns / 2;
    const long long half = (long long)rows * columns;
    for (int dy = -radius; s.coarse > 0 && dy <= radius; ++dy)
        for (int dx = -radius; dx <= radius; ++dx, logit += plane) {
            const int row = y / 2 + dy, column = x / 2 + dx;
            if (row < 0 || row >= rows || column < 0 || column >= columns) continue;
            const long long there = (long long)row * columns + column, at = b * 3 * half + there;
            const float valid = from.mask[b * half + there];
            if (valid == 0.0f) continue;
            visit(Tap{logit, from.colour + at, half, at, valid, 0.0f, from.logits[logit], -1});
        }
}

extern "C" __global__ void hush_apply(int batch, int frames, int rows, int columns, int coarse, const int *sizes, const float *logits,
                                      const float *images, const float *valid, const float *colour, const float *mask,
                                      const float *queries, const float *keys, float *out, float *norm) {
    const long long plane = (long long)rows * columns, index = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (index >= batch * plane) return;
    const int b = (int)(index / plane), y = (int)(index % plane) / columns, x = (int)(index % plane) % columns;
    float red = 0.0f, green = 0.0f, blue = 0.0f, total = 0.0f;
    each_tap({batch, frames, rows, columns, sizes, coarse}, {logits, images, valid, colour, mask, queries, keys}, b, y, x, [&](const Tap &t) {
        const float weight = tap_weight(t.moved, t.valid);
        red += weight * t.source[0];
        green += weight * t.source[t.channel];
        blue += weight * t.source[2 * t.channel];
        total += weight;
    });
    const float share = share_of(total);
    float *to = out + b * 3 * plane + index % plane;
    to[0] = red * share;
    to[plane] = green * share;
    to[2 * plane] = blue * share;
    norm[index] = total;
}

// What is added to must be 0 before; to_images may be null.
extern "C" __global__ void hush_apply_backward(int batch, int frames, int rows, int columns, int coarse, const int *sizes, const float *logits,
                                               const float *images, const float *valid, const float *colour, const float *mask,
                                               const float *queries, const float *keys, const float *out, const float *norm,
                                               const float *gradient, float *to_logits, float *to_images, float *to_colour, float *to_queries) {
    const long long plane = (long long)rows * columns, index = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (index >= batch * plane) return;
    const int b = (int)(index / plane), y = (int)(index % plane) / columns, x = (int)(index % plane) % columns;
    const long long own = b * 3 * plane + index % plane;
    const float share = share_of(norm[index]);
    const float g0 = gradient[own] * share, g1 = gradient[own + plane] * share, g2 = gradient[own + 2 * plane] * share;
    const float result = g0 * out[own] + g1 * out[own + plane] + g2 * out[own + 2 * plane];
    each_tap({batch, frames, rows, columns, sizes, coarse}, {logits, images, valid, colour, mask, queries, keys}, b, y, x, [&](const Tap &t) {
        const float weight = tap_weight(t.moved, t.valid);
        const float pull = logit_gradient(t.moved, weight, t.source[0], t.source[t.channel], t.source[2 * t.channel], g0, g1, g2, result);
        to_logits[t.logit] = pull;
        if (keys && t.frame >= 0) {
            float *to = to_queries + ((long long)b * frames + t.frame) * 2 * plane + index % plane;
            to[0] += pull * t.key;
            to[plane] += pull * t.key * t.key;
        }
        float *to = t.frame < 0 ? to_colour : to_images;
        if (to) {
            atomicAdd(to + t.at, weight * g0);
            atomicAdd(to + t.at + t.channel, weight * g1);
            atomicAdd(to + t.at + 2 * t.channel, weight * g2);
        }
    });
}
