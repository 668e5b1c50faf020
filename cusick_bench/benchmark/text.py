"""A benchmark's document as Markdown: targets first, then time and memory over mesh size, then the phases of a step."""

from collections.abc import Iterable, Iterator
from typing import Any

from cusick_bench.runner.environment import code_text

_WORD = {True: "yes", False: "**no**", None: "-"}


def markdown(document: dict[str, Any], command: str) -> str:
    """The tables.

    Args:
        document: From `benchmark`.
        command: What made it.

    Returns:
        Text.
    """
    hardware = document["hardware"]
    libraries = ", ".join(f"{name} {version}" for name, version in hardware["libraries"].items() if version)
    parts = [
        "# Benchmark of the simulator",
        f"`{command}`",
        f"{hardware['cores']} cores, {hardware['processor']}, {hardware['platform']}; code: {code_text(hardware)}; "
        f"Python {hardware['python']}, {libraries}. Medians; a drop is 100 steps.",
        *_device(document["device"]),
    ]
    if not document["plan"]["device_only"]:
        parts += [
            "The floor is 100 numeric factorisations and solves with the fastest backend installed, and nothing else.",
            *_targets(document),
            *_sizes(document["meshes"]),
            *_laws(document["laws"]),
            *_reference(document["reference"]),
            *_gradients(document["gradient_error"]),
        ]
    return "\n\n".join(parts) + "\n"


def _table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    header = list(header)
    lines = [header, [":---"] + ["---:"] * (len(header) - 1), *map(list, rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _targets(document: dict[str, Any]) -> Iterator[str]:
    yield "## Targets"
    yield _table(
        ("target", "measured", "limit", "met"),
        (
            (
                row["target"],
                "-" if row["measured"] is None else f"{row['measured']:.3g}",
                row["limit"],
                _WORD[row["met"]],
            )
            for row in document["targets"]
        ),
    )


def _device(device: dict[str, Any]) -> Iterator[str]:
    if not device:
        return
    meshes, name = device["meshes"], device.get("name", device["device"])
    yield f"## Torch engine on {name}, beside the compiled engine on the CPU"
    cases = list(dict.fromkeys(case for mesh in meshes for case in mesh["cases"]))
    yield _table(
        ("s (peak memory, GB)", *(f"{mesh['vertices']} vertices" for mesh in meshes)),
        ((case, *(_on_device(mesh, case) for mesh in meshes)) for case in cases),
    )
    rows = (
        (
            str(mesh["vertices"]), what, f"{rate['device']:.3g}", f"{rate['cpu']:.3g}",
            f"{mesh['times_faster'][what]:.3g}", f"{mesh['agreement']['positions_m']:.0e}",
            f"{max(mesh['agreement']['gradient'].values()):.0e}",
        )
        for mesh in meshes
        for what, rate in mesh["drapes_per_second"].items()
    )  # fmt: skip
    header = ("vertices", "", "drapes/s", "CPU drapes/s", "times", "positions differ by m", "gradients, of the largest")
    yield _table(header, rows)


def _on_device(mesh: dict[str, Any], case: str) -> str:
    if case not in mesh["cases"]:
        return "left out" if case in mesh["left_out"] else ""
    seconds, peak = f"{mesh['cases'][case]['median_s']:.3f}", mesh["peak_memory_bytes"][case]
    return seconds if peak is None else f"{seconds} ({peak / 1e9:.2f})"


def _sizes(meshes: list[dict[str, Any]]) -> Iterator[str]:
    names = [f"{mesh['vertices']} vertices" for mesh in meshes]
    for title, group, scale, digits in (
        ("Whole drapes [s] (ratio)", "cases", 1, 3),
        ("Phases of a step [ms]", "phases", 1e3, 2),
    ):
        yield f"## {title}"
        cases = list(dict.fromkeys(case for mesh in meshes for case in mesh[group]))
        yield _table(
            ("", *names), ((case, *(_cell(mesh, group, case, scale, digits) for mesh in meshes)) for case in cases)
        )
    yield "## Memory of a gradient [MB]"
    rows = (
        (name, *(f"{mesh['memory_bytes'][name] / 1e6:.0f}" for mesh in meshes)) for name in ("kept", "checkpointed")
    )
    yield _table(("factors", *names), rows)


def _laws(laws: dict[str, Any]) -> Iterator[str]:
    names = list(laws["meshes"][0]["step"])
    yield "## Laws side by side: a step [ms]"
    rows = [
        ("step", mesh, {law: mesh["step"][law] for law in names}, f"{mesh['ratio']['median']:.2f}")
        for mesh in laws["meshes"]
    ]
    for mesh in laws["meshes"]:
        for phase in mesh["phases"][names[0]]:
            timings = {law: mesh["phases"][law][phase] for law in names}
            ratio = timings[names[0]]["median_s"] / timings[names[1]]["median_s"]
            rows.append((phase, mesh, timings, f"{ratio:.2f}"))
    yield _table(
        ("", "vertices", *names, "ratio"),
        (
            (name, str(mesh["vertices"]), *(f"{1e3 * timings[law]['median_s']:.2f}" for law in names), ratio)
            for name, mesh, timings, ratio in rows
        ),
    )
    near = laws["equal_error"]
    if near is None:
        return
    yield f"## Time to come within {near['near_enough_points']:g} points of reference drapes"
    yield _table(
        ("law", "folds", "ln bending", "Poisson", "vertices", "error, points", "s", "near enough"),
        (
            (
                law, str(row["folds"]), f"{row['ln_bending']:g}", f"{row['poisson']:.3g}", str(row["vertices"]),
                "-" if row["error_points"] is None else f"{row['error_points']:.2f}",
                "-" if row["seconds"] is None else f"{row['seconds']:.3g}", _WORD[row["reached"]],
            )
            for law in names
            for row in near[law]["rows"]
        ),
    )  # fmt: skip


def _cell(mesh: dict[str, Any], group: str, case: str, scale: float, digits: int) -> str:
    if case not in mesh[group]:
        return ""
    ratios = {name.split(" / ")[0]: ratio["median"] for name, ratio in mesh["ratios"].items()}
    median = f"{scale * mesh[group][case]['median_s']:.{digits}f}"
    return f"{median} ({ratios[case]:.2f})" if case in ratios else median


def _reference(reference: dict[str, Any]) -> Iterator[str]:
    faster, memory = reference["times_faster"], reference["memory_bytes"]
    yield "## Against plain torch autograd"
    yield (
        f"{reference['vertices']} vertices, {reference['steps']} steps, forward and backward, the same gradient to "
        f"{reference['gradient_difference']:.0e}: {faster['median']:.0f} times as fast ({faster['low']:.0f} to "
        f"{faster['high']:.0f}), {memory['engine'] / 1e6:.0f} MB instead of {memory['autograd'] / 1e6:.0f}."
    )


def _gradients(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield "## Gradient of the whole pipeline against central differences"
    yield _table(
        ("mode, parameter", "direction", "relative error", "folds changed"),
        (
            (
                f"{row['mode']}, {row['parameter']}",
                "per element" if row["per_element"] else "all together",
                f"{row['relative_error']:.1e}",
                "yes" if row["branch_changed"] else "no",
            )
            for row in rows
        ),
    )
