from pinfric.model.described import (
    EFFORT,
    derived,
    described,
    quantity,
)


@described
class Before:
    """What one drive did."""

    name: str = quantity("the drive's", heading="joint", name=True)
    unit: str = quantity("of its effort", heading="unit")
    peak: float = quantity("largest effort", EFFORT, "peak")

    @property
    @derived(heading="twice", cell="{double:.1f}")
    def double(self) -> float:
        """Two times the peak."""
        return 2.0 * self.peak


@described
class After(Before):
    """The same with one line more."""

    jerk: float | None = quantity("largest jerk", "rad/s^3 or m/s^3", "jerk", default=1234.5)
