// Kernel application for training on the CPU: model.py's `kernel_average` and its gradient without the (taps × pixels) intermediates.
// Built and called by fused.py. All arrays are contiguous f32, rows last but one, columns last.

#include "tap.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace {

struct Shape {
    std::ptrdiff_t batch, frames, rows, columns;
    const int *sizes; // width of each frame's kernel
    int coarse; // width of the kernel over the coarser level, 0 without
    std::ptrdiff_t plane() const { return rows * columns; }
    std::ptrdiff_t taps() const {
        std::ptrdiff_t sum = coarse * coarse;
        for (std::ptrdiff_t f = 0; f < frames; ++f) sum += sizes[f] * sizes[f];
        return sum;
    }
};

struct Tap {
    const float *source[3]; // three channels of the row that is read, shifted to the tap's column
    const float *valid;
    std::ptrdiff_t first, last; // columns whose tap lies inside the frame
    std::ptrdiff_t index; // among all taps
    std::ptrdiff_t shift; // columns; twice the coarse columns for a coarse tap
    std::ptrdiff_t coarse_row; // of the coarser level, −1 for a frame's tap
    const float *key; // the tap's, null for a coarse tap and without keys
    const float *query; // the row's first of its frame, the second a plane further
    std::ptrdiff_t query_at; // its index
    std::ptrdiff_t image_at; // index of red of the row that is read, shifted as `source`; of a frame's tap
};

// The coarser level's colour (B, 3, h, w) and valid mask (B, 1, h, w); null without.
struct Coarse {
    const float *colour, *mask;
};

// One coarse row at twice its width, each pixel twice; channels 0…2 and the valid mask.
void expand(const Coarse &coarse, std::ptrdiff_t b, std::ptrdiff_t half_plane, std::ptrdiff_t row, std::ptrdiff_t half_columns, float *wide) {
    for (int c = 0; c < 4; ++c) {
        const float *from = (c < 3 ? coarse.colour + (b * 3 + c) * half_plane : coarse.mask + b * half_plane) + row * half_columns;
        float *to = wide + c * 2 * half_columns;
        for (std::ptrdiff_t x = 0; x < half_columns; ++x) to[2 * x] = to[2 * x + 1] = from[x];
    }
}

// Calls visit(Tap) for each tap of a row, in the order of the logits.
template <typename Visit>
void each_tap(const Shape &s, std::ptrdiff_t b, std::ptrdiff_t y, const float *images, const float *valid, const Coarse &coarse, const float *queries, const float *keys, float *wide, Visit visit) {
    const std::ptrdiff_t w = s.columns, plane = s.plane();
    std::ptrdiff_t index = 0;
    for (std::ptrdiff_t f = 0; f < s.frames; ++f) {
        const int radius = s.sizes[f] / 2;
        const float *image = images + (b * s.frames + f) * 3 * plane, *mask = valid + (b * s.frames + f) * plane, *key = keys ? keys + (b * s.frames + f) * plane : nullptr;
        const std::ptrdiff_t query_at = (b * s.frames + f) * 2 * plane + y * w;
        for (int dy = -radius; dy <= radius; ++dy)
            for (int dx = -radius; dx <= radius; ++dx, ++index) {
                if (y + dy < 0 || y + dy >= s.rows) continue;
                const std::ptrdiff_t at = (y + dy) * w + dx;
                visit(Tap{{image + at, image + plane + at, image + 2 * plane + at}, mask + at, std::max<std::ptrdiff_t>(0, -dx), std::min(w, w - dx), index, dx, -1, key ? key + at : nullptr, key ? queries + query_at : nullptr, query_at, (b * s.frames + f) * 3 * plane + at});
            }
    }
    const int radius = s.coarse / 2;
    const std::ptrdiff_t half_rows = s.rows / 2, half_columns = w / 2;
    for (int dy = -radius; s.coarse > 0 && dy <= radius; ++dy) {
        const std::ptrdiff_t row = y / 2 + dy;
        if (row < 0 || row >= half_rows) {
            index += s.coarse;
            continue;
        }
        expand(coarse, b, half_rows * half_columns, row, half_columns, wide);
        for (int dx = -radius; dx <= radius; ++dx, ++index) {
            const std::ptrdiff_t at = 2 * dx;
            visit(Tap{{wide + at, wide + w + at, wide + 2 * w + at}, wide + 3 * w + at, std::max<std::ptrdiff_t>(0, -at), std::min(w, w - at), index, at, row, nullptr, nullptr, 0, 0});
        }
    }
}

// The logits of a tap in a row, moved by its keys.
void moved_by_keys(const Tap &t, const float *logit, std::ptrdiff_t plane, float *out) {
    if (t.key == nullptr) {
        std::copy(logit + t.first, logit + t.last, out + t.first);
        return;
    }
    for (std::ptrdiff_t x = t.first; x < t.last; ++x) out[x] = keyed(logit[x], t.key[x], t.query[x], t.query[plane + x]);
}

} // namespace

extern "C" {

void hush_apply(std::ptrdiff_t batch, std::ptrdiff_t frames, std::ptrdiff_t rows, std::ptrdiff_t columns, const int *sizes, int coarse_size,
                const float *logits, const float *images, const float *valid, const float *colour, const float *mask, const float *queries, const float *keys, float *out, float *norm) {
    const Shape s{batch, frames, rows, columns, sizes, coarse_size};
    const std::ptrdiff_t plane = s.plane(), taps = s.taps();
    std::vector<float> wide(4 * columns), moved(columns);
    for (std::ptrdiff_t b = 0; b < batch; ++b)
        for (std::ptrdiff_t y = 0; y < rows; ++y) {
            float *r0 = out + b * 3 * plane + y * columns, *r1 = r0 + plane, *r2 = r1 + plane, *total = norm + b * plane + y * columns;
            each_tap(s, b, y, images, valid, {colour, mask}, queries, keys, wide.data(), [&](const Tap &t) {
                moved_by_keys(t, logits + (b * taps + t.index) * plane + y * columns, plane, moved.data());
                const float *logit = moved.data();
                for (std::ptrdiff_t x = t.first; x < t.last; ++x) {
                    const float weight = tap_weight(logit[x], t.valid[x]);
                    r0[x] += weight * t.source[0][x];
                    r1[x] += weight * t.source[1][x];
                    r2[x] += weight * t.source[2][x];
                    total[x] += weight;
                }
            });
            for (std::ptrdiff_t x = 0; x < columns; ++x) {
                const float share = share_of(total[x]);
                r0[x] *= share;
                r1[x] *= share;
                r2[x] *= share;
            }
        }
}

// What is added to must be 0 before; to_images may be null.
void hush_apply_backward(std::ptrdiff_t batch, std::ptrdiff_t frames, std::ptrdiff_t rows, std::ptrdiff_t columns, const int *sizes, int coarse_size,
                         const float *logits, const float *images, const float *valid, const float *colour, const float *mask, const float *queries, const float *keys,
                         const float *out, const float *norm, const float *gradient, float *to_logits, float *to_images, float *to_colour, float *to_queries) {
    const Shape s{batch, frames, rows, columns, sizes, coarse_size};
    const std::ptrdiff_t plane = s.plane(), taps = s.taps(), half_columns = columns / 2, half_plane = plane / 4;
    std::vector<float> wide(4 * columns), g(3 * columns), centre(columns), spread(3 * columns), moved(columns);
    for (std::ptrdiff_t b = 0; b < batch; ++b)
        for (std::ptrdiff_t y = 0; y < rows; ++y) {
            float *g0 = g.data(), *g1 = g0 + columns, *g2 = g1 + columns;
            for (std::ptrdiff_t x = 0; x < columns; ++x) {
                const std::ptrdiff_t at = b * 3 * plane + y * columns + x;
                const float share = share_of(norm[b * plane + y * columns + x]);
                g0[x] = gradient[at] * share;
                g1[x] = gradient[at + plane] * share;
                g2[x] = gradient[at + 2 * plane] * share;
                centre[x] = g0[x] * out[at] + g1[x] * out[at + plane] + g2[x] * out[at + 2 * plane];
            }
            each_tap(s, b, y, images, valid, {colour, mask}, queries, keys, wide.data(), [&](const Tap &t) {
                const std::ptrdiff_t at = (b * taps + t.index) * plane + y * columns;
                moved_by_keys(t, logits + at, plane, moved.data());
                const float *logit = moved.data();
                float *to = to_logits + at;
                for (std::ptrdiff_t x = t.first; x < t.last; ++x) {
                    const float weight = tap_weight(logit[x], t.valid[x]);
                    to[x] = logit_gradient(logit[x], weight, t.source[0][x], t.source[1][x], t.source[2][x], g0[x], g1[x], g2[x], centre[x]);
                }
                if (t.key != nullptr) {
                    float *first = to_queries + t.query_at, *second = first + plane;
                    for (std::ptrdiff_t x = t.first; x < t.last; ++x) {
                        first[x] += to[x] * t.key[x];
                        second[x] += to[x] * t.key[x] * t.key[x];
                    }
                }
                if (t.coarse_row < 0 && to_images == nullptr) return;
                for (int c = 0; c < 3; ++c) {
                    const float *share = g.data() + c * columns;
                    float *row = spread.data() + c * columns;
                    for (std::ptrdiff_t x = t.first; x < t.last; ++x) row[x] = tap_weight(logit[x], t.valid[x]) * share[x];
                    if (t.coarse_row < 0) {
                        float *target = to_images + t.image_at + c * plane;
                        for (std::ptrdiff_t x = t.first; x < t.last; ++x) target[x] += row[x];
                        continue;
                    }
                    float *target = to_colour + (b * 3 + c) * half_plane + t.coarse_row * half_columns + t.shift / 2;
                    for (std::ptrdiff_t x = t.first; x < t.last; x += 2) target[x / 2] += row[x] + row[x + 1];
                }
            });
        }
}
}
