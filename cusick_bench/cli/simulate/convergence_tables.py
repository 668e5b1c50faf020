"""The tables that `cusick-bench convergence` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.table import Table

from cusick_bench.cli.common import output

if TYPE_CHECKING:
    from cusick_bench.benchmark.convergence.linear_plate import LinearPlate
    from cusick_bench.benchmark.convergence.mesh_dependence import MeshChange, MeshRow
    from cusick_bench.benchmark.convergence.order import Limit, Order
    from cusick_bench.benchmark.convergence.reference import PlateComparison, PlateOrder
    from cusick_bench.benchmark.convergence.time_step import TimeStep


def _table(title: str, *names: str) -> Table:
    table = Table(title=title)
    for name in names:
        table.add_column(name, justify="right")
    return table


def _order(order: Order | None) -> str:
    if order is None:
        return "-"
    return f"{order.order:.2f}" + ("" if order.standard_error is None else f" ± {order.standard_error:.2f}")


def _text(value: float | None, form: str) -> str:
    return "-" if value is None or value != value else format(value, form)


def print_reference(found: Sequence[PlateComparison], law: str, meshes: int) -> None:
    """Prints drapes beside those of a table of reference drapes.

    Args:
        found: The comparisons.
        law: Material law of the drapes.
        meshes: Meshes of one size for each drape.
    """
    names = (
        "folds", "ln bending", "Poisson", "vertices", "drape coefficient", "error points", "reference ± points",
        "rim min error mm", "rim max error mm", "rim lowest error mm", "deflection ratio", "folds found", "seconds",
    )  # fmt: skip
    several = meshes > 1
    table = _table(
        f"law {law} against reference drapes" + (f", means of {meshes} meshes" if several else ""),
        *names, *(["sd points"] if several else []),
    )  # fmt: skip
    for one in found:
        cells = [
            str(one.folds), f"{one.ln_bending:g}", f"{one.poisson:.3g}", str(one.vertices),
            _text(one.drape_coefficient, ".4f"), _text(one.error_points, "+.2f"), f"{one.accuracy_points:.2g}",
            _text(one.rim_min_error_mm, "+.3f"), _text(one.rim_max_error_mm, "+.3f"),
            _text(one.rim_lowest_error_mm, "+.3f"), _text(one.deflection_ratio, ".4f"),
            "/".join(str(folds) for folds in sorted(set(one.folds_found))) or "-", _text(one.seconds, ".2f"),
        ]  # fmt: skip
        table.add_row(*cells, *([_text(one.drape_coefficient_sd_points, ".3f")] if several else []))
    output.print(table)
    fixed = {one.poisson_simulated for one in found if one.poisson_simulated != one.poisson}
    for poisson in sorted(fixed):
        output.print(f"law {law} bends with a Poisson's ratio of {poisson:.3g} whatever the row's: it is fixed")
    for one in found:
        for failure in one.failures:
            output.print(f"{one.folds} folds, ln bending {one.ln_bending:g}, {one.vertices} vertices: {failure}")


def print_orders(orders: Sequence[PlateOrder]) -> None:
    """Prints how fast the errors against reference drapes fall with finer meshes.

    Args:
        orders: A row for each reference drape.
    """
    names = ("folds", "ln bending", "Poisson", "drape coefficient", "deflection")
    table = _table("observed order of the errors", *names)
    for one in orders:
        both = (_order(one.drape_coefficient), _order(one.deflection))
        table.add_row(str(one.folds), f"{one.ln_bending:g}", f"{one.poisson:.3g}", *both)
    output.print(table)
    output.print("order: slope of log error over log spacing of vertices ± standard error (from three sizes on)")


def print_meshes(rows: Sequence[MeshRow], draws: int, cloth: Mapping[str, float], limit: Limit | None) -> None:
    """Prints the drapes of one cloth by the size of the mesh.

    Args:
        rows: A row for each size.
        draws: Drapes of each size.
        cloth: Its `density` [kg/m2] and `bending` [N m].
        limit: Drape coefficient extrapolated to meshes without end, None where that cannot be done.
    """
    density, bending = cloth["density"], cloth["bending"]
    names = ["vertices", "drapes", "drape coefficient", "folds", "fold depth mm"]
    spread = any(row.mesh_sd_points is not None for row in rows)
    title = f"{draws} drapes each, {density:g} kg/m2, {bending:g} N m (mean ± standard error)"
    table = _table(title, *names, *(["sd over meshes points"] if spread else []))
    for row in rows:
        cells = [
            str(row.vertices), str(row.drapes), f"{row.drape_coefficient:.4f} ± {row.drape_coefficient_se:.4f}",
            f"{row.folds:.2f} ± {row.folds_se:.2f}", f"{row.fold_depth_mm:.2f} ± {row.fold_depth_mm_se:.2f}",
        ]  # fmt: skip
        table.add_row(*cells, *([_text(row.mesh_sd_points, ".2f")] if spread else []))
    output.print(table)
    if limit is None:
        why = "fewer than three sizes or drapes, or no order to be seen"
        output.print(f"drape coefficient: no limit can be extrapolated ({why})")
        return
    low, high = limit.value_90
    order = f"{limit.order:.2f} ({limit.order_90[0]:.2f} to {limit.order_90[1]:.2f})"
    output.print(f"drape coefficient: limit {limit.value:.4f} ({low:.4f} to {high:.4f}), observed order {order}; 90 %")


def print_plate(plate: LinearPlate) -> None:
    """Prints the deflections of a stiff plate beside the exact one.

    Args:
        plate: The deflections.
    """
    title = f"linear plate, Poisson's ratio {plate.poisson:.3g}: exact deflection of the rim {plate.exact_mm:.4f} mm"
    table = _table(title, "vertices", "mesh", "deflection mm", "ratio to exact")
    for row in plate.rows:
        table.add_row(str(row.vertices), str(row.mesh), f"{row.deflection_mm:.4f}", f"{row.ratio:.4f}")
    output.print(table)
    output.print(f"observed order of the deflection's error: {_order(plate.order)}")
    for failure in plate.failures:
        output.print(failure)


def print_changes(changes: Sequence[MeshChange]) -> None:
    """Prints how much the statistics of a diagnosis change with the mesh.

    Args:
        changes: Of each size against the largest one.
    """
    from cusick_bench.benchmark.convergence.mesh_dependence import largest_change
    from cusick_bench.diagnosis.measure.statistics import GROUPS, NAMES

    if not changes:
        return
    title = f"statistics of a diagnosis: largest change against {changes[0].against} vertices, in sd between drapes"
    table = _table(title, "vertices", "draws", *GROUPS)
    for change in changes:
        cells = []
        for columns in GROUPS.values():
            one = largest_change(change.statistics, [NAMES[column] for column in columns])
            cells.append("-" if one is None else f"{one.change_sd:+.2f} ± {one.error_sd:.2f}\n{one.name}")
        table.add_row(str(change.vertices), str(change.draws), *cells)
    output.print(table)
    output.print("paired by drape, ± standard error; the statistic of each group that changes most")


def print_time_step(time: TimeStep) -> None:
    """Prints drops beside their rests, and how much drops change when the time step is halved.

    Args:
        time: What was measured.
    """
    table = _table(
        f"drops against their rests, {time.vertices} vertices", "steps", "step s", "draws", "at rest %",
        "same branch %", "distance mm", "drape coefficient points",
    )  # fmt: skip
    for row in time.rests:
        table.add_row(
            str(row.steps), f"{row.step_seconds:g}", str(row.draws), _text(100 * row.at_rest, ".0f"),
            _text(100 * row.same_branch, ".0f"), _text(row.distance_mm, ".4f"),
            _text(row.drape_coefficient_points, ".4f"),
        )  # fmt: skip
    output.print(table)
    for change in time.halvings:
        title = f"step halved from {change.step_seconds:g} to {change.halved_seconds:g} s, {change.draws} draws"
        table = _table(title, "statistic", "change", "change in sd between drapes")
        for one in change.statistics:
            seen = "-" if one.change_sd is None else f"{one.change_sd:+.2f} ± {one.error_sd:.2f}"
            table.add_row(one.name, f"{one.change:+.4f}", seen)
        output.print(table)
