"""Measured efforts over the computed ones."""

from identify_cases import NAMES, parameter


def test_measured_and_identified_efforts_are_shown_together(found):
    figure = found.plot()
    assert len(figure.axes) == len(NAMES)
    drawn = {line.get_gid() for line in figure.axes[1].lines}
    assert {"measured", "computed"} <= drawn
    table = found.summary()
    assert (
        table.loc[f"friction.{NAMES[2]}.mu", "value"] == parameter(found, "friction", 2, "mu").value
    )
