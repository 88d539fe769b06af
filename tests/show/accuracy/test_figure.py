"""The picture of time against accuracy."""

from __future__ import annotations

from accuracy_cases import of

from pinfric.show.accuracy.figure import accuracy_figure
from pinfric.show.accuracy.report import accuracy_frame, accuracy_report


def test_table_and_picture(pendulum, tmp_path):
    from rich.console import Console

    console = Console(width=100, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(*accuracy_report(pendulum), sep="\n")
    text = console.export_text()
    for expected in ("rtol 1e-10", "dt 4.00e-03 s", "velocity 1e-02", "frictionless", "+ static"):
        assert expected in text
    frame = accuracy_frame(pendulum)
    assert set(frame["study"]) == {"simulation", "sampling", "ladder"}
    assert (frame["study"] == "simulation").sum() == len(pendulum.runs)
    figure = accuracy_figure(pendulum)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == 4
    assert shown[0].get_xscale() == shown[0].get_yscale() == "log"
    drawn = {line.get_label(): line.get_ydata() for line in shown[0].lines}
    assert max(drawn["event"]) == max(run.error for run in of(pendulum.runs, "event"))
    figure.savefig(tmp_path / "accuracy.png")
    assert (tmp_path / "accuracy.png").read_bytes().startswith(b"\x89PNG")
