"""Measures Hush and OIDN on the benchmark's shots, prints the tables of RESULTS.md, the λ curves, and those of equal error.

    python -m training.benchmark.run --cache runs/benchmark --hush target/release/hush --update training/RESULTS.md
    python -m training.benchmark.run --cache runs/benchmark --hush target/release/hush --lambdas 1,2,4,8,16,32,64
    python -m training.benchmark.run --cache runs/benchmark --hush target/release/hush --equal-error --shots interior
    python -m training.benchmark.run --cache runs/benchmark-5.2 --references runs/benchmark --section benchmark-5.2 --ratios-only …

The cache comes from training.benchmark.render; frames without a reference are denoised, for their neighbours' sake, but not scored.
OIDN's frames are kept in the cache, by its version; Hush's are made anew. Tables go to standard output and, with the numbers, to --out;
--update writes them into a document, between its markers. --references takes another cache's references, for the frames of another
Blender whose beauty has the same mean: training.benchmark.same_mean tells.
The unbiased errors are those of `hush eval` between the halves of the references' passes. Their brightness is what OIDN, as Cycles runs
it, makes of the most samples that the shot has in the cache: bright as the truth, not made from the references, and the same for every
method and every number of samples.
Needs pyoidn, OpenEXR, numpy; no PyTorch.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from training.benchmark import equal_error, lambda_curves, oidn, tables
from training.benchmark.frames import FIRST_SHOTS, SHOTS, SPP, Take, for_oidn, frame, numbers, shared_levels, takes, write_beauty


class Hush:
    """The program, with the options that every run shares."""

    def __init__(self, program: Path, model: Path | None, threads: int) -> None:
        self.program = program.resolve()
        self.options = ["--threads", str(threads), "--no-settings", "--quiet", "--overwrite", *(["--model", str(model)] if model else [])]

    def denoise(self, take: Take, output: Path, window: int, lam: float = 1.0) -> Path:
        options = ["--window", str(window), "--lambda", f"{lam:g}", *self.options]
        self.run("denoise", take.noisy, "--output", output, *options)
        return output

    def scores(self, take: Take, folder: Path, reference: Path | None = None) -> dict[str, list[float | None]]:
        """Scores of a folder by metric and frame, over the frames that have a reference."""
        found = self._eval(reference or take.reference, folder, take)
        return {metric: [row[metric] for row in found] for metric in ("smape", "relmse", "flip", "flicker")}

    def unbiased(self, take: Take, folder: Path, brightness: Path) -> dict[str, list[float | None]]:
        """Those without the references' noise, over the frames that have two passes; of flicker the squares."""
        first, second = take.halves
        if not numbers(first):
            return {"unbiased_relmse": [], "unbiased_flicker": []}
        found = [row["unbiased"] or {} for row in self._eval(first, folder, take, "--reference-b", second, "--brightness", brightness)]
        return {f"unbiased_{name}": [row.get(key) for row in found] for name, key in (("relmse", "relmse"), ("flicker", "flicker_squared"))}

    def _eval(self, reference: Path, folder: Path, take: Take, *options: str | Path) -> list[dict[str, Any]]:
        found = json.loads(self.run("eval", reference, folder, "--vectors", take.noisy, "--json", *options))
        return [row["scores"] for row in found["frames"]]

    def run(self, *arguments: str | Path) -> str:
        """What the program prints; where it fails, this one ends with what it says."""
        result = subprocess.run([self.program, *arguments], capture_output=True, text=True, check=False)
        if result.returncode:
            raise SystemExit(f"hush {' '.join(map(str, arguments))}: {result.stderr.strip() or result.stdout.strip()}")
        return result.stdout


def run_oidn(take: Take, device: Any, method: str) -> Path:  # noqa: ANN401
    """OIDN on a take's frames, by one of its methods."""
    return denoised_by_oidn(take.noisy, take.peer(method, oidn.version()), device, method)


def denoised_by_oidn(noisy: Path, folder: Path, device: Any, method: str) -> Path:  # noqa: ANN401
    """OIDN frame by frame, into `folder`; what is newer there than its noisy frame stays."""
    for n in numbers(noisy):
        source, target = frame(noisy, n), frame(folder, n)
        if target.exists() and target.stat().st_mtime >= source.stat().st_mtime:
            continue
        write_beauty(target, oidn.METHODS[method](device, *for_oidn(source)))
    return folder


def measure(take: Take, hush: Hush, device: Any, out: Path, methods: Sequence[str]) -> dict[str, tables.Scores]:  # noqa: ANN401
    """The scores of methods on a take."""
    brightness = run_oidn(take.most_samples, device, tables.PEER)
    scores: dict[str, tables.Scores] = {}
    for method in methods:
        if method in oidn.METHODS:
            folder = run_oidn(take, device, method)
        elif method.startswith("window"):
            folder = hush.denoise(take, out / take.shot / f"{take.spp}spp-{method}", int(method.removeprefix("window")))
        else:
            folder = take.noisy
        scores[method] = hush.scores(take, folder) | hush.unbiased(take, folder, brightness)
    return scores


def mid_shot(measured: Sequence[Take], results: tables.Results) -> tables.Results:
    """The results without the frames at both ends of a shot, whose window of ±2 is not whole: half of these short shots."""
    made: dict[tuple[str, int], dict[str, tables.Scores]] = {}
    for take in measured:
        there, clean, in_halves = (numbers(folder) for folder in (take.noisy, take.reference, take.halves[0]))
        made[take.shot, take.spp] = {
            method: {
                metric: tables.in_mid_shot(metric, by_frame, in_halves if metric.startswith("unbiased") else clean, there)
                for metric, by_frame in scores.items()
            }
            for method, scores in results[take.shot, take.spp].items()
        }
    return made


def about(measured: list[Take], shots: Sequence[str], with_peer: bool = True) -> str:
    """What was measured, in a sentence or two; `with_peer`, against OIDN and with unbiased errors."""
    parts = []
    for take in {take.shot: take for take in measured}.values():
        brightness = f", brightness from {take.most_samples.spp} spp" if with_peer else ""
        parts.append(f"{take.shot} {len(numbers(take.reference))} frames, {take.passes_a_frame} passes{brightness}")
    missing = [shot for shot in shots if shot not in {take.shot for take in measured}]
    left_out = f" Not measured: {', '.join(missing)}." if missing else ""
    said = f"References: {'; '.join(parts)}.{left_out}"
    return f"OIDN {oidn.version()}. {said} ± is one standard error over the frames." if with_peer else said


def reference_noise(measured: list[Take], hush: Hush) -> str:
    """How far two passes of the references are from each other, and how far, if noise is all, their mean is from the truth."""
    rows = []
    for take in {take.shot: take for take in measured}.values():
        if len(take.passes) > 1:
            count = min(sum(frame(folder, n).exists() for folder in take.passes) for n in numbers(take.reference))
            smape = tables.mean(hush.scores(take, take.passes[0], take.passes[1])["smape"]) or 0.0
            rows.append([take.shot, tables.number(smape), str(count), tables.number(smape / math.sqrt(2 * count))])
    titles = ["SMAPE of the references' own noise", "a pass against another", "passes", "the mean of all, estimated"]
    return tables.table(titles, rows) if rows else ""


def lambdas(text: str) -> list[float]:
    values = sorted(float(part) for part in text.split(","))
    if not values or not all(1 <= value <= 64 for value in values):
        raise argparse.ArgumentTypeError("from 1 to 64, such as 1,4,16,64")
    return values


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder of training.benchmark.render")
    parser.add_argument("--references", type=Path, help="folder of the references, where it is another one")
    parser.add_argument("--hush", type=Path, required=True, help="the program")
    parser.add_argument("--model", type=Path, help="other weights than the program's own")
    parser.add_argument("--out", type=Path, help="folder for Hush's frames and the results (CACHE/results)")
    parser.add_argument("--shots", nargs="+", choices=SHOTS, default=list(SHOTS))
    parser.add_argument("--spp", nargs="+", type=int, help=f"samples ({' '.join(map(str, SPP))}; for --equal-error all in the cache)")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--lambdas", type=lambdas, help="curves over these values, window ±2, instead of the tables")
    parser.add_argument("--equal-error", action="store_true", help="the samples that OIDN needs for Hush's error, instead of the tables")
    parser.add_argument("--ratios-only", action="store_true", help="the shares of OIDN's errors alone")
    parser.add_argument("--update", type=Path, help="document to write the tables into, such as training/RESULTS.md")
    parser.add_argument("--section", help="of the document (benchmark, lambda, equal-error)")
    parser.add_argument("--figure", type=Path, help="SVG for the curves (OUT/lambda.svg, OUT/equal-error.svg)")
    chosen = parser.parse_args()
    out = chosen.out or chosen.cache / "results"
    out.mkdir(parents=True, exist_ok=True)
    spp = chosen.spp or (shared_levels(chosen.cache, chosen.shots) if chosen.equal_error else SPP)
    measured = takes(chosen.cache, chosen.shots, spp, chosen.references)
    if not measured:
        raise SystemExit(f"{chosen.cache}: nothing to measure yet; run training.benchmark.render")
    hush = Hush(chosen.hush, chosen.model, chosen.threads)
    if chosen.lambdas:
        curves = lambda_curves.curves(measured, chosen.lambdas, hush, out)
        text = f"{about(measured, chosen.shots, with_peer=False)}\n\n{lambda_curves.report(curves)}"
        (chosen.figure or out / "lambda.svg").write_text(lambda_curves.figure(curves), encoding="utf-8")
        name, rows = "lambda", [vars(point) for point in curves]
    else:
        shown = tables.IN_RATIOS if chosen.ratios_only else tuple(tables.METHODS)
        methods = (tables.PEER, equal_error.METHOD) if chosen.equal_error else shown
        with oidn.device(chosen.threads) as device:
            results = {(take.shot, take.spp): measure(take, hush, device, out, methods) for take in measured}
        if chosen.equal_error:
            parts = (about(measured, chosen.shots), equal_error.report(results))
            (chosen.figure or out / "equal-error.svg").write_text(equal_error.figure(results), encoding="utf-8")
        else:
            found = tables.report(results, mid_shot(measured, results), FIRST_SHOTS, chosen.ratios_only)
            noise = "" if chosen.ratios_only else reference_noise(measured, hush)
            parts = (about(measured, chosen.shots), found, noise)
        text = "\n\n".join(part for part in parts if part)
        name = "equal-error" if chosen.equal_error else "benchmark"
        rows = [{"shot": shot, "spp": spp, **scores} for (shot, spp), scores in results.items()]
    (out / f"{name}.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    (out / f"{name}.md").write_text(text + "\n", encoding="utf-8")
    print(text)
    if chosen.update:
        document = chosen.update.read_text(encoding="utf-8")
        chosen.update.write_text(tables.replaced(document, chosen.section or name, text), encoding="utf-8")


if __name__ == "__main__":
    main()
