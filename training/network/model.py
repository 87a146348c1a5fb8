"""The Hush network: a temporal, multi-scale, kernel-predicting denoiser after Vogels et al. 2018.

Shapes: B examples, T frames (the centre frame and its neighbours), C channels, H rows, W columns;
H and W are multiples of 8. Half, quarter and eighth resolution are h = H/2, H/4 and H/8.
`src/network` in the Rust core computes the same function; `golden.py` writes the tensors that hold the two together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.data.geometry import BRIGHTEST, EXTRAS, warped
from training.network.layers import Encoder, Residual, Specialisation, code_of, residuals, silent
from training.network.second_pass import dialled

LOGIT_LIMIT = 40.0
QUERIES = 2
VARIANCES = 7
UNSEEN = -3.0  # logit at which new taps begin: hardly any weight beside trained ones


@dataclass(frozen=True)
class Architecture:
    """Everything that the Rust network needs to build itself; stored in the weights file's header.

    albedo_levels is 1 or 3, variance and second_pass are 0 or 1.
    """

    version: int = 2
    features: int = 32
    half: int = 48
    quarter: int = 80
    eighth: int = 96
    blocks_encoder: int = 1
    blocks_half: int = 1
    blocks_quarter: int = 2
    blocks_eighth: int = 1
    blocks_out: int = 1
    pair: int = 32
    lambda_hidden: int = 16
    centre_taps: int = 5
    neighbour_taps: int = 3
    coarse_taps: int = 3
    albedo_taps: int = 3
    albedo_levels: int = 1
    levels: int = 4
    albedo_epsilon: float = 0.05
    variance: int = 0
    second_pass: int = 0

    def header(self) -> dict[str, int | float]:
        """What the weights file says; what is as in older files is left out."""
        return {k: v for k, v in asdict(self).items() if (k, v) not in (("albedo_levels", 1), ("variance", 0), ("second_pass", 0))}


def pixel_taps(image: Tensor, size: int) -> Tensor:
    """(B, C, H, W) to (B, C, size², H, W): each pixel's neighbourhood, rows first, zero outside."""
    b, c, h, w = image.shape
    return F.unfold(image, size, padding=size // 2).view(b, c, size * size, h, w)


def kernel_average(
    logits: Tensor,
    images: Tensor,
    valid: Tensor,
    sizes: tuple[int, ...],
    coarse: tuple[Tensor, Tensor] | None = None,
    coarse_taps: int = 0,
    keyed: tuple[Tensor, Tensor] | None = None,
) -> tuple[Tensor, Tensor]:
    """One softmax over the taps of all frames and of the coarser level, and its weighted average.

    logits (B, K, H, W): size² of each frame, rows first, then coarse_taps² of the coarser level; images (B, T, 3, H, W);
    valid (B, T, 1, H, W) in {0, 1}; coarse: image (B, 3, H/2, W/2) and mask; keyed: queries (B, T, 2, H, W) and keys (B, T, 1, H, W):
    the logit of a frame's tap gets the first query times its key and the second times its key squared. Returns the average
    (B, 3, H, W), 0 where no tap is valid, and the sum of the weights (B, 1, H, W).
    """
    if keyed is not None:
        queries, keys = keyed
        near = [pixel_taps(keys[:, k], size)[:, 0] for k, size in enumerate(sizes)]
        moved = torch.cat([queries[:, k, :1] * key + queries[:, k, 1:] * key * key for k, key in enumerate(near)], 1)
        logits = logits.float() + F.pad(moved, (0, 0, 0, 0, 0, logits.shape[1] - moved.shape[1]))
    taps = [pixel_taps(torch.cat((images[:, k], valid[:, k]), 1), size) for k, size in enumerate(sizes)]
    if coarse is not None:
        taps.append(pixel_taps(torch.cat(coarse, 1), coarse_taps).repeat_interleave(2, -1).repeat_interleave(2, -2))
    every = torch.cat(taps, 2)
    weights = torch.exp(logits.float().clamp(-LOGIT_LIMIT, LOGIT_LIMIT)) * every[:, 3]
    norm = weights.sum(1, keepdim=True)
    return (weights[:, None] * every[:, :3]).sum(2) / norm.clamp_min(1e-30), norm


def key_of(colour: Tensor, exposure: Tensor) -> Tensor:
    """What a tap's logit may depend on: the log of its light, (B, T, 1, H, W), of demodulated colours (B, T, 3, H, W).

    exposure (B,): the centre frame's.
    """
    return torch.log1p((colour.mean(2, keepdim=True) * exposure.view(-1, 1, 1, 1, 1)).clamp(0, BRIGHTEST))


def variances(keys: Tensor, albedo: Tensor, valid: Tensor) -> Tensor:
    """How noisy a pixel is, (B, VARIANCES, H/2, W/2), of keys (B, T, 1, H, W), albedo (B, T, 3, H, W) and valid (B, T, 1, H, W).

    Variance over the frames, within 2×2 pixels of the centre frame, and within 2×2 of the mean over the frames: of the albedo (the mean of
    its channels) and of the key each, as log1p(1e4 · v) / 8; and one over the frames that are valid, 1 at most.
    """
    guides = torch.cat((albedo, keys), 2)
    count = valid.sum(1)
    mean = (guides * valid).sum(1) / count.clamp_min(1.0)
    within = lambda x: F.avg_pool2d((x - upsampled(F.avg_pool2d(x, 2))) ** 2, 2)
    between = F.avg_pool2d(((guides - mean[:, None]) ** 2 * valid).sum(1) / count.clamp_min(1.0), 2)
    parts = [part for x in (between, within(guides[:, 0]), within(mean)) for part in (x[:, :3].mean(1, keepdim=True), x[:, 3:])]
    share = 1.0 / F.avg_pool2d(count, 2).clamp_min(1.0)
    return torch.cat((*((1e4 * part).log1p() / 8.0 for part in parts), share), 1)


def over_neighbours(layer: Callable[[Tensor], Tensor], x: Tensor) -> Tensor:
    """A layer for images over the neighbours (B, N, C, h, w) as one batch."""
    return layer(x.flatten(0, 1)).unflatten(0, x.shape[:2])


def upsampled(image: Tensor) -> Tensor:
    return F.interpolate(image, scale_factor=2, mode="nearest")


def subpixels(logits: Tensor) -> Tensor:
    """(B, 4·K, h, w), grouped by sub-pixel (0,0) (0,1) (1,0) (1,1), to (B, K, 2h, 2w)."""
    b, k4, h, w = logits.shape
    x = logits.view(b, 2, 2, k4 // 4, h, w)
    return x.permute(0, 3, 4, 1, 5, 2).reshape(b, k4 // 4, 2 * h, 2 * w)


def down(image: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
    """Uniform 2×2 down-sampling over the valid pixels: (…C, H, W), (…1, H, W) to half size."""
    weight = F.avg_pool2d(valid, 2)
    mean = F.avg_pool2d(image * valid, 2) / weight.clamp_min(0.25)
    return mean, (weight > 0).to(image.dtype)


def queries(channels: int, count: int) -> nn.Conv2d:
    """Predicts `count` pairs of queries, 0 at the start of training."""
    return silent(channels, QUERIES * count)


class Hush(nn.Module):
    """The whole network. `forward` takes one centre frame and n ≥ 0 neighbours; `average` applies the kernels."""

    average = staticmethod(kernel_average)

    def __init__(self, arch: Architecture | None = None) -> None:
        super().__init__()
        a = self.arch = arch or Architecture()
        self.encoder = Encoder(a.features, a.blocks_encoder)
        self.mix_centre = nn.Conv2d(a.features, a.half, 1)
        self.mix_neighbour = nn.Conv2d(a.features + EXTRAS, a.half, 1, bias=False)
        self.mix = nn.Conv2d(a.features + a.half + a.variance * VARIANCES, a.half, 1)
        self.half_in = residuals(a.half, a.blocks_half)
        self.to_quarter = nn.Conv2d(a.half, a.quarter, 3, stride=2, padding=1)
        self.quarter_in = residuals(a.quarter, a.blocks_quarter)
        self.to_eighth = nn.Conv2d(a.quarter, a.eighth, 3, stride=2, padding=1)
        self.eighth = residuals(a.eighth, a.blocks_eighth)
        self.from_eighth = nn.Conv2d(a.eighth + a.quarter, a.quarter, 1)
        self.lambda_quarter = Specialisation(a.quarter, a.lambda_hidden)
        self.quarter_out = Residual(a.quarter)
        self.from_quarter = nn.Conv2d(a.quarter + a.half, a.half, 1)
        self.lambda_half = Specialisation(a.half, a.lambda_hidden)
        self.half_out = residuals(a.half, a.blocks_out)
        centre, neighbour, coarse = a.centre_taps**2, a.neighbour_taps**2, a.coarse_taps**2
        self.head_half = nn.Conv2d(a.half, 4 * (centre + coarse + a.albedo_taps**2) + centre + coarse, 1)
        self.pair_half_centre = nn.Conv2d(a.half, a.pair, 1)
        self.pair_half_neighbour = nn.Conv2d(a.features + EXTRAS, a.pair, 1, bias=False)
        self.pair_half_head = nn.Conv2d(a.pair, 4 * (neighbour + 1) + neighbour, 1)
        self.query_half = queries(a.half, 5)
        self.pair_half_query = queries(a.pair, 5)
        self.head_quarter = nn.Conv2d(a.quarter, centre + (coarse if a.levels > 3 else 0), 1)
        self.pair_quarter_centre = nn.Conv2d(a.quarter, a.pair, 1)
        self.pair_quarter_neighbour = nn.Conv2d(a.features + EXTRAS, a.pair, 1, bias=False)
        self.pair_quarter_head = nn.Conv2d(a.pair, neighbour, 1)
        self.query_quarter = queries(a.quarter, 1)
        self.pair_quarter_query = queries(a.pair, 1)
        if a.levels > 3:
            self.head_eighth = nn.Conv2d(a.eighth, centre, 1)
            self.pair_eighth_centre = nn.Conv2d(a.eighth, a.pair, 1)
            self.pair_eighth_neighbour = nn.Conv2d(a.features + EXTRAS, a.pair, 1, bias=False)
            self.pair_eighth_head = nn.Conv2d(a.pair, neighbour, 1)
            self.query_eighth = queries(a.eighth, 1)
            self.pair_eighth_query = queries(a.pair, 1)
        if a.albedo_levels > 1:
            albedo = a.albedo_taps**2
            self.head_albedo_half = silent(a.half, 4 * coarse + albedo + coarse)
            self.pair_albedo_half_head = silent(a.pair, 1)
            nn.init.constant_(self.head_albedo_half.bias[: 4 * coarse], UNSEEN)
            self.head_albedo_quarter = silent(a.quarter, albedo)
            self.pair_albedo_quarter_head = silent(a.pair, 1)
        if a.second_pass:
            self.pair_second_head = silent(a.pair, 4)
            nn.init.constant_(self.pair_second_head.bias[:1], UNSEEN)

    def trunk(self, centre: Tensor, pairs: Tensor | None, noise: Tensor | None, lam: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Temporal extractor, U-shaped body and loss specialisation: features at half, quarter and eighth resolution.

        centre (B, features, h, w); pairs: of N neighbours (B, N, features + EXTRAS, h, w), channel `features` their trust, or None; noise:
        `variances` where the architecture has them.
        """
        f = self.arch.features
        base = self.mix_centre(centre)
        around = torch.zeros_like(base)
        if pairs is not None:
            trust = pairs[:, :, f : f + 1]
            total = (trust * F.relu(base[:, None] + over_neighbours(self.mix_neighbour, pairs))).sum(1)
            around = total / (1.0 + trust.sum(1))
        half = self.half_in(self.mix(torch.cat((centre, around) if noise is None else (centre, around, noise.to(centre.dtype)), 1)))
        quarter = self.quarter_in(self.to_quarter(F.relu(half)))
        eighth = self.eighth(self.to_eighth(F.relu(quarter)))
        quarter = self.from_eighth(torch.cat((upsampled(eighth), quarter), 1))
        quarter = self.quarter_out(self.lambda_quarter(quarter, lam))
        half = self.from_quarter(torch.cat((upsampled(quarter), half), 1))
        half = self.half_out(self.lambda_half(half, lam))
        return half, quarter, eighth

    def filtered_albedo(
        self,
        albedo: Tensor,
        masks: list[Tensor],
        full: list[Tensor],
        body: tuple[Tensor, Tensor],
        hidden: tuple[Tensor | None, Tensor | None],
    ) -> Tensor:
        """The centre's albedo (B, 3, H, W), averaged over the frames, and over the pyramid where the architecture says so; without keys.

        albedo (B, T, 3, H, W); masks: the valid pixels of each level; full: the logits of the taps at full resolution; body: the features
        at half and quarter resolution; hidden: those of the neighbours' kernels there, None without neighbours.
        """
        a, t = self.arch, albedo.shape[1]
        images = [albedo]
        for k in range(1, a.albedo_levels):
            images.append(down(images[-1].flatten(0, 1), masks[k - 1].flatten(0, 1))[0].unflatten(0, (-1, t)))
        sizes = (a.albedo_taps, *[1] * (t - 1))

        def level(k: int, parts: list[Tensor], coarse: tuple[Tensor, Tensor] | None) -> tuple[Tensor, Tensor]:
            found, norm = self.average(torch.cat(parts, 1), images[k], masks[k], sizes, coarse, a.coarse_taps if coarse else 0)
            return found, (norm > 0).float()

        coarse, taps = None, a.coarse_taps**2
        if a.albedo_levels > 1:
            near = lambda head, of: [] if of is None else [over_neighbours(head, of).flatten(1, 2)]
            coarse = level(2, [self.head_albedo_quarter(body[1]), *near(self.pair_albedo_quarter_head, hidden[1])], None)
            logits = self.head_albedo_half(body[0])
            own, below = logits[:, 4 * taps :].split((a.albedo_taps**2, taps), 1)
            coarse = level(1, [own, *near(self.pair_albedo_half_head, hidden[0]), below], coarse)
            full = [*full, subpixels(logits[:, : 4 * taps])]
        filtered, found = level(0, full, coarse)
        return torch.where(found > 0, filtered, albedo[:, 0])

    def encode(self, inputs: Tensor) -> Tensor:
        """(B, F, 10, H, W) inputs to (B, F, features, H/2, W/2)."""
        return self.encoder(inputs.flatten(0, 1)).unflatten(0, inputs.shape[:2])

    def forward(self, batch: dict[str, Tensor], lam: Tensor) -> dict[str, Tensor]:
        """Denoise the centre frames: `encode`, then `denoise`. batch also has `inputs` (B, T, 10, H, W), centre first."""
        return self.denoise(self.encode(batch["inputs"]), batch, lam)

    def denoise(self, features: Tensor, batch: dict[str, Tensor], lam: Tensor) -> dict[str, Tensor]:
        """From the features (B, T, features, h, w), centre first.

        batch: `colour` (B, T, 3, H, W) demodulated and `albedo` (B, T, 3, H, W), neighbours already warped; `valid`
        (B, T, 1, H, W) in {0, 1}; `position` (B, T−1, 2, h, w) where each neighbour's features are sampled; `extras`
        (B, T−1, EXTRAS, h, w), channel 0 the trust; `exposure` (B,) of the centre frame.
        Returns `image` (B, 3, H, W) and the demodulated `colour`, `half`, `quarter`, `eighth` and the filtered `albedo`; where there is a
        second pass and a neighbour, its logits `second` (B, T−1, 2, h, w).
        """
        a = self.arch
        t = features.shape[1]
        pairs = None
        if t > 1:
            moved = warped(features[:, 1:].flatten(0, 1), batch["position"].flatten(0, 1)).unflatten(0, (-1, t - 1))
            pairs = torch.cat((moved, batch["extras"].to(features.dtype)), 2)
        colour, albedo, valid = (batch[name].float() for name in ("colour", "albedo", "valid"))
        noise = variances(key_of(colour, batch["exposure"]), albedo, valid) if a.variance else None
        half, quarter, eighth = (F.relu(x) for x in self.trunk(features[:, 0], pairs, noise, lam))
        head = self.head_half(half)
        n_centre, n_near, n_coarse, n_albedo = a.centre_taps**2, a.neighbour_taps**2, a.coarse_taps**2, a.albedo_taps**2
        per_pixel = n_centre + n_coarse + n_albedo
        full = subpixels(head[:, : 4 * per_pixel]).split((n_centre, n_coarse, n_albedo), 1)
        half_logits = head[:, 4 * per_pixel :].split((n_centre, n_coarse), 1)
        query = self.query_half(half)
        full_queries, half_queries = [subpixels(query[:, : 4 * QUERIES])[:, None]], [query[:, None, 4 * QUERIES :]]
        near_full, near_half, near_albedo, half_hidden = [], [], [], None
        if pairs is not None:
            half_hidden = F.relu(self.pair_half_centre(half)[:, None] + over_neighbours(self.pair_half_neighbour, pairs))
            h, query = over_neighbours(self.pair_half_head, half_hidden), over_neighbours(self.pair_half_query, half_hidden)
            near = over_neighbours(subpixels, h[:, :, : 4 * (n_near + 1)])
            near_full, near_albedo = [near[:, :, :n_near].flatten(1, 2)], [near[:, :, n_near:].flatten(1, 2)]
            near_half = [h[:, :, 4 * (n_near + 1) :].flatten(1, 2)]
            full_queries.append(over_neighbours(subpixels, query[:, :, : 4 * QUERIES]))
            half_queries.append(query[:, :, 4 * QUERIES :])

        def coarser(pairs: Tensor) -> Tensor:
            return over_neighbours(lambda x: F.avg_pool2d(x, 2), pairs)

        def near_kernels(level: str, features: Tensor, pairs: Tensor) -> tuple[Tensor, list[Tensor], list[Tensor]]:
            """The hidden features of the neighbours' kernels at quarter or eighth resolution, their logits, and their queries."""
            layer = lambda name: getattr(self, f"pair_{level}_{name}")
            hidden = F.relu(layer("centre")(features)[:, None] + over_neighbours(layer("neighbour"), pairs))
            return hidden, [over_neighbours(layer("head"), hidden).flatten(1, 2)], [over_neighbours(layer("query"), hidden)]

        quarter_logits = self.head_quarter(quarter).split((n_centre, self.head_quarter.out_channels - n_centre), 1)
        quarter_hidden, near_quarter, quarter_queries = None, [], []
        if pairs is not None:
            pairs = coarser(pairs)
            quarter_hidden, near_quarter, quarter_queries = near_kernels("quarter", quarter, pairs)
        quarter_queries.insert(0, self.query_quarter(quarter)[:, None])

        images = [(colour, valid)]
        for _ in range(a.levels - 1):
            image, mask = down(images[-1][0].flatten(0, 1), images[-1][1].flatten(0, 1))
            images.append((image.unflatten(0, (-1, t)), mask.unflatten(0, (-1, t))))
        sizes = (a.centre_taps, *[a.neighbour_taps] * (t - 1))

        def level(k: int, parts: list[Tensor], queries: list[Tensor], coarse: tuple[Tensor, Tensor] | None) -> tuple[Tensor, Tensor]:
            """One pyramid level and where any tap was valid: holes are filled from the coarser levels.

            The coarse taps are the paper's blend: their summed weight is α, their shares a predicted up-sampling kernel, so
            o = (1 − α)·f + α·U(o_coarse) is a weighted average of rendered pixels.
            """
            keyed = torch.cat(queries, 1).float(), key_of(images[k][0], batch["exposure"])
            out, norm = self.average(torch.cat(parts, 1), *images[k], sizes, coarse, a.coarse_taps, keyed)
            return out, (norm > 0).float()

        out_eighth = None
        if a.levels > 3:
            near, eighth_queries = [], []
            if pairs is not None:
                _, near, eighth_queries = near_kernels("eighth", eighth, coarser(pairs))
            eighth_queries.insert(0, self.query_eighth(eighth)[:, None])
            out_eighth = level(3, [self.head_eighth(eighth), *near], eighth_queries, None)
        out_quarter = level(2, [quarter_logits[0], *near_quarter, quarter_logits[1]], quarter_queries, out_eighth)
        out_half = level(1, [half_logits[0], *near_half, half_logits[1]], half_queries, out_quarter)
        out, _ = level(0, [full[0], *near_full, full[1]], full_queries, out_half)

        masks, hidden = [mask for _, mask in images], (half_hidden, quarter_hidden)
        filtered = self.filtered_albedo(albedo, masks, [full[2], *near_albedo], (half, quarter), hidden)
        result = {"image": out * filtered, "colour": out, "half": out_half[0], "quarter": out_quarter[0], "albedo": filtered}
        if out_eighth:
            result["eighth"] = out_eighth[0]
        if a.second_pass and half_hidden is not None:
            result["second"] = dialled(over_neighbours(self.pair_second_head, half_hidden), code_of(lam, half.shape[-1]))
        return result
