// What one tap of a kernel is worth and how it learns: the arithmetic that fused.cpp (CPU) and apply.cu (GPU) share.
#pragma once

#ifdef __CUDACC__
#define TAP_FUNCTION static __device__ __forceinline__
#else
#include <cmath>
#define TAP_FUNCTION static inline
#endif

constexpr float LOGIT_LIMIT = 40.0f;

// The logit of a tap, moved by its key and the two queries of its pixel.
TAP_FUNCTION float keyed(float logit, float key, float first, float second) { return logit + key * (first + second * key); }

// The weight of a tap before it is divided by the sum of all; valid in {0, 1}.
TAP_FUNCTION float tap_weight(float logit, float valid) { return expf(fminf(fmaxf(logit, -LOGIT_LIMIT), LOGIT_LIMIT)) * valid; }

// One over the sum of the weights; 0 of nothing is 0.
TAP_FUNCTION float share_of(float norm) { return 1.0f / fmaxf(norm, 1e-30f); }

// The gradient of a tap's logit. red, green, blue: the tap's colour; g: the result's gradient × share_of(norm); result: Σ g · result.
TAP_FUNCTION float logit_gradient(float logit, float weight, float red, float green, float blue, float g0, float g1, float g2, float result) {
    return fabsf(logit) <= LOGIT_LIMIT ? weight * (g0 * red + g1 * green + g2 * blue - result) : 0.0f;
}
