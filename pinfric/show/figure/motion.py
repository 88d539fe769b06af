"""Figure of a simulated motion: a row per joint with position, velocity and friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.dynamics.inverse.result import runs
from pinfric.dynamics.simulation.motion import Motion
from pinfric.model.brief import counted
from pinfric.model.coordinates import is_sliding, one_number
from pinfric.model.described import PLACE, SPEED, effort_where, unit_at
from pinfric.show.figure.efforts import dress, shade, thinned
from pinfric.show.figure.panel import key_below, sheet
from pinfric.show.figure.registry import draws
from pinfric.show.figure.style import BLUE, INK, QUIET, style
from pinfric.show.report.names import picture_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FRICTION, _LIMIT = BLUE, "#8A8A8A"
#: Joints drawn, and inches a row takes of few and of many.
_MOST, _TALL, _LOW = 16, 1.9, 1.2
#: Beside 1 rad or m, and beside the value itself: what changes less stands still.
_ROUNDING = 1e-9
#: Letters of a joint's name above its row.
_LETTERS = 60


@dataclass(frozen=True, eq=False)
class _Row:
    """A joint as it is drawn: (T,) position and velocity; None without a single number.

    `site` is its column of friction, -1: none; `kind`: 0 sticks and slips, 1 slides all the time, 2
    never moves; `travel` is its range, rad or m.
    """

    name: str
    sliding: bool
    position: np.ndarray | None
    velocity: np.ndarray | None
    site: int
    kind: int
    travel: float


@draws(Motion, "motion")
def motion_figure(motion: Motion) -> Figure:
    """Draw the joints of a motion, a row each: position, velocity, friction against its limits.

    Where the joint sticks is shaded. Of more than 16 joints those that move are drawn: first those
    that stick and slip, then the farthest travelled (a metre as a radian).
    """
    rows = _rows(motion)
    order = sorted(rows, key=lambda row: (row.kind, -row.travel))
    if len(rows) > _MOST:
        order = [row for row in order if row.kind < 2][:_MOST] or order[:_MOST]
    drawn = [row for row in rows if row in order]
    height = _TALL if len(drawn) <= 4 else _LOW
    names = [row.name for row in rows]
    labels, note = picture_names(names, _LETTERS)
    title = f"{Path(motion.scene.source).stem} · {motion.method}\n"
    title += f"{counted(len(drawn), 'joint')} over {motion.t[-1] - motion.t[0]:.3g} s"
    if others := [row for row in rows if row not in order]:
        still = sum(row.kind == 2 for row in others)
        parts = [f"{still} that never move"] * bool(still)
        parts += [f"{len(others) - still} that travel less"] * (len(others) > still)
        title += f"; not drawn: {' and '.join(parts)}"
    model = motion.scene.model
    if many := [name for name, nv in zip(model.names, model.nvs, strict=True) if nv > 1]:
        title += f"; without {', '.join(many)}, which has several positions"
    with style():
        figure = sheet(11.0, height * max(len(drawn), 1) + 1.3, title + note)
        if drawn:
            panels = figure.subplots(len(drawn), 3, sharex=True, squeeze=False)
            short = dict(zip(names, labels, strict=True))
            for row, axes in zip(drawn, panels, strict=True):
                _draw(axes, motion, row, short[row.name])
            around = 0.5 if len(motion.t) == 1 else 0.0  # an instant has no width
            panels[0, 0].set_xlim(motion.t[0] - around, motion.t[-1] + around)
            for column in panels.T:
                for axes in [axes for axes in column if axes.axison][-1:]:
                    axes.set_xlabel("time (s)")
                    axes.tick_params(labelbottom=True)
            figure.align_ylabels()
            key_below(figure)
    return figure


def _rows(motion: Motion) -> list[_Row]:
    """Return joints of one number each, then the other sites: loops, followers."""
    model, sites = motion.scene.model, motion.scene.sites
    at = {site.name: s for s, site in enumerate(sites)}
    rows = []
    for index in range(1, model.njoints):
        joint, name = model.joints[index], model.names[index]
        if joint.nv != 1:
            continue
        q = one_number(joint, motion.q)
        velocity = motion.v[:, joint.idx_v]
        s = at.pop(name, -1)
        rows.append(
            _Row(
                name,
                is_sliding(joint),
                q,
                velocity,
                s,
                _kind(motion, s, velocity),
                float(np.ptp(q)),
            )
        )
    for name, s in at.items():
        column = sites[s].velocity_index
        rate = None if column < 0 else sites[s].ratio * motion.v[:, column]
        rows.append(_Row(name, sites[s].sliding, None, rate, s, _kind(motion, s, rate), np.inf))
    return rows


def _kind(motion: Motion, site: int, velocity: np.ndarray | None) -> int:
    if site < 0:
        return 1 if velocity is not None and velocity.any() else 2
    sticks = motion.phase_modes[:, site] == 0
    return 2 if sticks.all() else 0 if sticks.any() else 1


def _draw(panels: Sequence[Axes], motion: Motion, row: _Row, name: str) -> None:
    effort = effort_where(row.sliding)
    for axes, values, unit in zip(
        panels, (row.position, row.velocity), (PLACE, SPEED), strict=False
    ):
        if values is None:
            axes.axis("off")
        else:
            _line(axes, motion.t, values, color=INK, linewidth=1.2, label="position, velocity")
            _dress(axes, motion, row.site, unit_at(unit, effort))
    last = panels[2]
    if row.site < 0:
        last.axis("off")
        _say(last, "no friction")
    else:
        static, load = motion.scene.sites[row.site].law.static, motion.normal_load[:, row.site]
        for limit in (-(static.mu * load + static.forward), static.mu * load + static.backward):
            look: dict[str, Any] = {"linestyle": (0, (4, 2)), "label": "its static limits"}
            _line(last, motion.t, limit, color=_LIMIT, linewidth=0.9, **look)
        friction = motion.friction[:, row.site]
        _line(last, motion.t, friction, color=_FRICTION, linewidth=1.5, label="friction")
        _dress(last, motion, row.site, effort)
    if row.position is None:
        _say(panels[0], "closes a loop" if row.velocity is None else "follows another joint")
    panels[0].set_title(name, fontweight="bold", color=INK)


def _line(axes: Axes, t: np.ndarray, values: np.ndarray, **look: Any) -> None:
    kept = thinned([values])
    axes.plot(t[kept], values[kept], **look)


def _say(axes: Axes, text: str) -> None:
    axes.annotate(text, (0.02, 0.5), xycoords="axes fraction", color=QUIET, va="center")


def _dress(axes: Axes, motion: Motion, site: int, unit: str) -> None:
    values = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in axes.lines])
    values = values[np.isfinite(values)]
    middle = float(values.mean()) if values.size else 0.0
    if not values.size or np.ptp(values) <= _ROUNDING * max(1.0, abs(middle)):
        axes.set_ylim(middle - 0.5, middle + 0.5)  # rounding is no motion
    axes.set_ylabel(unit)
    dress(axes, 4)
    if site >= 0:
        t, sticks = motion.phase_t, runs(motion.phase_modes[:, site] == 0)
        spans = np.array([(t[a], t[b + 1]) for a, b in sticks]).reshape(-1, 2)
        shade(axes, spans, "this joint sticks")
