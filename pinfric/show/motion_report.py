"""What a simulated motion says: tables for people, a dictionary for machines, one picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.dynamics.motion import Motion
from pinfric.dynamics.result import runs
from pinfric.show.report import digits, json_safe
from pinfric.show.tables import Column, Kind, Table, counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.console import RenderableType

_LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#222222", "#999999")
_STICKING, _LIMIT = "#E69F00", "#999999"
#: Of more stick intervals, events or sites than this the first, or the largest, are printed.
_MOST_ROWS = 12


def motion_json(motion: Motion, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """Return everything `pinfric simulate --json` prints; SI units, None for what is no number."""
    energy = motion.energy()
    return json_safe({
        "scene": motion.scene.source,
        "method": motion.method,
        "status": motion.status,
        "message": motion.message,
        "t_end": motion.t[-1],
        "samples": len(motion.t),
        "evaluations": motion.evaluations,
        "stick_intervals": [asdict(interval) for interval in motion.stick_intervals()],
        "events": [asdict(event) for event in motion.events],
        "energy": {
            "work": energy.work,
            "change": energy.change,
            "friction_loss": dict(zip(motion.site_names, energy.friction_loss, strict=True)),
            "residual": energy.residual,
        },
        "end": {"q": motion.q[-1], "v": motion.v[-1]},
        "warnings": list(warnings),
    })  # fmt: skip


def motion_report(motion: Motion) -> list[RenderableType]:
    """Return the tables and lines that `pinfric simulate` prints, for a rich console."""
    from rich.text import Text

    name = Path(motion.scene.source).stem
    title = (
        f"{name} · {motion.method}: {digits(float(motion.t[-1]))} s, {len(motion.t)} samples, "
        f"{motion.evaluations} right-hand sides"
    )
    items: list[RenderableType] = [Text(title, style="bold"), Text()]
    intervals = motion.stick_intervals()
    if intervals:
        rows = [
            (i.site, f"{i.start:.6f}", f"{i.end:.6f}", digits(i.end - i.start)) for i in intervals
        ]
        columns = (
            Column("joint", Kind.NAME, motion.site_names),
            *map(Column, ("from s", "to s", "for s")),
        )
        items.append(_first("sticks", columns, rows))
    else:
        items.append(Text("no joint sticks"))
    if motion.events:
        rows = [(f"{e.time:.6f}", e.name, e.kind, _way(e.kind, e.direction)) for e in motion.events]
        columns = (Column("time s"), Column("joint", Kind.NAME, motion.scene.joint_names),
                   Column("what", Kind.LABEL), Column("way", Kind.LABEL))  # fmt: skip
        items += [Text(), _first("events", columns, rows)]
    items += [Text(), _energy_table(motion)]
    if motion.status != "finished":
        items += [Text(), Text(f"{motion.status}: {motion.message}")]
    return items


def _way(kind: str, direction: int) -> str:
    if kind == "limit":
        return "above" if direction > 0 else "below"
    return {1: "forward", -1: "backward"}.get(direction, "")


def _first(title: str, columns: Sequence[Column], rows: Sequence[tuple[str, ...]]) -> Table:
    if len(rows) > _MOST_ROWS:
        title += f" (the first {_MOST_ROWS} of {len(rows)})"
    return Table(title, columns, rows[:_MOST_ROWS])


def _energy_table(motion: Motion) -> Table:
    """The balance; of many sites those with the most heat, and the rest in one line."""
    energy = motion.energy()
    losses = [float(loss) for loss in energy.friction_loss]
    order = sorted(range(len(losses)), key=lambda s: -abs(losses[s]))
    few = len(order) <= _MOST_ROWS
    shown = set(order) if few else {s for s in order[:_MOST_ROWS] if losses[s]}
    rows = [
        ("work of the drives", digits(energy.work)),
        ("kinetic and potential", digits(energy.change)),
        *((f"heat at {site}", digits(losses[s])) for s, site in enumerate(motion.site_names)
          if s in shown),
    ]  # fmt: skip
    if rest := [s for s in order if s not in shown]:
        heat = digits(sum(losses[s] for s in rest))
        rows.append((f"heat at {counted(len(rest), 'further joint')}", heat))
    rows.append(("unaccounted", digits(energy.residual)))
    return Table("energy", (Column("", Kind.NAME), Column("J")), rows)


def motion_figure(motion: Motion) -> Figure:
    """Draw a motion: positions, velocities with sticking shaded, friction against its limits."""
    from matplotlib.figure import Figure

    sites = motion.scene.sites
    rows = 2 + len(sites)
    figure = Figure(figsize=(10.0, 1.0 + 2.1 * rows), dpi=150, layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    name = Path(motion.scene.source).stem
    figure.suptitle(f"{name} · {motion.method}", x=0.01, ha="left", fontsize=13, fontweight="bold")
    _positions(axes[0], motion)
    _velocities(axes[1], motion)
    for s, one in enumerate(axes[2:]):
        _friction(one, motion, s)
    for one in axes:
        one.axhline(0, color="#BBBBBB", linewidth=0.7, zorder=0)
        one.spines[["top", "right"]].set_visible(False)
        one.margins(x=0)
    axes[-1].set_xlabel("time (s)")
    return figure


def _positions(axes: Axes, motion: Motion) -> None:
    """One number per degree of freedom: an angle, a length, or what moved since the start."""
    model = motion.scene.model
    for i, (name, values) in enumerate(_single_positions(motion)):
        axes.plot(motion.t, values, color=_LINES[i % len(_LINES)], label=name)
    many = [n for n, nv in zip(model.names, model.nvs, strict=True) if nv > 1]
    title = "positions (rad, m)" + (f"; without {', '.join(many)}" if many else "")
    axes.set_title(title, loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _single_positions(motion: Motion) -> list[tuple[str, np.ndarray]]:
    model = motion.scene.model
    found = []
    for index in range(1, model.njoints):
        joint = model.joints[index]
        if joint.nv != 1:
            continue
        q = motion.q[:, joint.idx_q]
        if joint.nq == 2:
            q = np.unwrap(np.arctan2(motion.q[:, joint.idx_q + 1], q))
        found.append((model.names[index], q))
    return found


def _velocities(axes: Axes, motion: Motion) -> None:
    model = motion.scene.model
    i = 0
    for index in range(1, model.njoints):
        joint = model.joints[index]
        if joint.nv == 1:
            color = _LINES[i % len(_LINES)]
            axes.plot(motion.t, motion.v[:, joint.idx_v], color=color, label=model.names[index])
            i += 1
    for interval in motion.stick_intervals():
        axes.axvspan(interval.start, interval.end, color=_STICKING, alpha=0.18, linewidth=0)
    axes.set_title("velocities (rad/s, m/s); shaded: a joint sticks", loc="left", fontsize=10)


def _friction(axes: Axes, motion: Motion, s: int) -> None:
    site = motion.scene.sites[s]
    law, load = site.law, motion.normal_load[:, s]
    forward, backward = (
        -(law.mu_static * load + law.static_positive),
        (law.mu_static * load + law.static_negative),
    )
    axes.plot(motion.t, forward, color=_LIMIT, linewidth=0.9, linestyle=(0, (4, 2)))
    axes.plot(motion.t, backward, color=_LIMIT, linewidth=0.9, linestyle=(0, (4, 2)))
    axes.plot(motion.t, motion.friction[:, s], color=_LINES[0])
    for first, last in runs(motion.phase_modes[:, s] == 0):
        span = motion.phase_t[first], motion.phase_t[last + 1]
        axes.axvspan(*span, color=_STICKING, alpha=0.18, linewidth=0)
    unit = "N" if site.sliding else "N m"
    axes.set_title(
        f"{site.name}: friction ({unit}); dashed: its static limits", loc="left", fontsize=10
    )
