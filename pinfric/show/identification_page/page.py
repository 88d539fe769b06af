"""The identification page: one self-contained HTML file, no network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pinfric import __version__
from pinfric.show.figure.panel import svg
from pinfric.show.identification_page.figures import over_time, residual_clouds
from pinfric.show.report.rows import table_of
from pinfric.show.sizing_page.page import page_parts
from pinfric.study.identify.identify import Identified
from pinfric.study.identify.laws import PLAIN
from pinfric.study.identify.parameters import Parameter
from pinfric.study.identify.summary import identify_summary, predicted
from pinfric.study.summary import effort_unit

#: Coefficients whose standard errors are listed for each advised recording.
_WORST = 12


def identification_page(found: Identified) -> str:
    """Return what logs say of a robot's friction as one HTML page.

    Args:
        found: of `identify`.

    Raises:
        PinfricError: the extra `report` (jinja2) is not installed.
    """
    environment = page_parts(Path(__file__).parent)
    summary = identify_summary(found)
    time = over_time(found)
    joints: list[dict[str, Any]] = []
    for j, name in enumerate(found.scene.joint_names):
        if name not in found.errors:
            continue
        pictures = {"time": svg(time[j], f"Efforts of {name} over time")} | {
            kind: svg(cloud, f"Residual of {name} over {kind}")
            for kind, cloud in residual_clouds(found, j).items()
        }
        joints.append(_joint_view(found, j, name) | pictures)
    page: str = environment.get_template("identification.html.j2").render(
        found=found,
        laws=table_of("", summary.joints),
        unseen=table_of("", predicted(summary)),
        delay=found.estimate.delay,
        scene=Path(found.scene.source).stem,
        logs=found.recordings,
        duration=sum(one.trajectory.duration for one in found.recordings),
        determined=sum(p.determined for p in found.parameters),
        joints=joints,
        vague=[
            p.key
            for p in sorted(found.parameters, key=_vagueness)
            if p.key in found.advice[0].factors
        ][:_WORST],
        version=__version__,
    )
    return page


def _vagueness(parameter: Parameter) -> float:
    """Least where a coefficient is known worst."""
    return -parameter.standard_error / max(abs(parameter.value), 1e-300)


def _joint_view(found: Identified, joint: int, name: str) -> dict[str, Any]:
    """What the template shows of one joint."""
    errors = found.estimate.choice.errors[joint]
    plain = errors.get(PLAIN, float("nan"))
    laws = [
        (law, errors[law], errors[law] / plain) for law in sorted(errors, key=errors.__getitem__)
    ]
    return {
        "name": name,
        "law": found.law_of(name),
        "error": found.errors[name],
        "rest": found.rest[name],
        "spread": found.spread[name],
        "laws": laws,
        "unit": effort_unit(found.scene, joint),
    }
