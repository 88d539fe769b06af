import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump

import pinfric as pf
from pinfric.errors import TrajectoryError
from pinfric.motions.log.reading import ReadingOptions

T = np.arange(400) / 200.0


def swung(t):
    """Positions of both joints at times, (T, 2)."""
    return np.column_stack((0.8 * np.sin(2 * t), 0.3 + 0.2 * np.cos(3 * t)))


Q = swung(T)


V = np.column_stack((1.6 * np.cos(2 * T), -0.6 * np.sin(3 * T)))


def arm(lower=-2.0, upper=2.0, speed=4.0):
    """Two joints, `base_turn` and `arm_lift`, both limited."""
    body = lump(2.0, [0.3, 0, 0], 0.02)
    model = chain(("base_turn", pin.JointModelRZ(), body), ("arm_lift", pin.JointModelRY(), body))
    model.effortLimit[:], model.velocityLimit[:] = 100.0, speed
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = lower, upper
    return pf.Scene(model=model)


def table(header, *columns, mark=",", form="%.12g"):
    lines = [mark.join(form % x for x in row) for row in np.column_stack(columns)]
    return "\n".join([mark.join(header), *lines]) + "\n"


def load(folder, text, name="log.csv", scene=None, **options):
    (folder / name).write_text(text)
    return pf.load_trajectory(folder / name, scene or arm(), ReadingOptions(**options))


def refused(folder, text, **options):
    with pytest.raises(TrajectoryError) as caught:
        load(folder, text, **options)
    return str(caught.value)


NAMES = ("base_turn", "arm_lift")


PLAIN = table(("t", *NAMES), T, Q)


JUGGLED = [f"/joint_states/{n}/{k}" for k in ("position", "velocity") for n in NAMES]


WANTED = [f"desired/{name}/position" for name in NAMES]


MORE = [f"{n}{k}" for k in (" [rad/s]", " [Nm]") for n in NAMES]


PAIRS = list(zip(T.tolist(), *Q.T.tolist(), strict=True))


DIALECTS = {
    "semicolons": table(("time", *NAMES), T, Q, mark=";"),
    "tabs": table(("timestamp", *NAMES), T, Q, mark="\t"),
    "decimal commas": table(("t", *NAMES), T, Q, mark=";").replace(".", ","),
    "plotjuggler": table(("__time", *JUGGLED), T, Q, V),
    "dots": table(("Time", *(f"joint_states.{n}.pos" for n in NAMES)), T, Q),
    "brackets": table(("time [s]", *(f"{n} [rad]" for n in NAMES)), T, Q),
    "prefix": table(("t", *(f"q_{n}" for n in NAMES)), T, Q),
    "degrees by name": table(("t", *(f"{n} [deg]" for n in NAMES)), T, np.degrees(Q)),
    "milliseconds by name": table(("t_ms", *NAMES), 1e3 * T, Q),
    "comment header of np.savetxt": "# " + table(("t", *NAMES), T, Q),
    "comment header of np.savetxt, spaces": "# made by\n# " + table(("t", *NAMES), T, Q, mark=" "),
    "spaces": table(("t", *NAMES), T, Q, mark=" "),
    "aligned by spaces": table(("t", *NAMES), T, Q, mark="   ", form="%18.12g"),
    "spaces and decimal commas": table(("t", *NAMES), T, Q, mark=" ").replace(".", ","),
    "units of all": table(("t", *NAMES, *MORE), T, Q, V, 7.0 * Q),
    "recorder of the UR": table(
        (
            "timestamp",
            "target_q_0",
            "target_q_1",
            "actual_q_0",
            "actual_q_1",
            "actual_qd_0",
            "actual_qd_1",
            "actual_TCP_pose_0",
            "actual_TCP_pose_1",
        ),
        T,
        -Q,
        Q,
        V,
        -Q,
        mark=" ",
    ),
    "numbered from 1": table(("t", "joint_1_position", "joint_2_position"), T, Q),
    "numbered from 0": table(("t", "q_0", "q_1"), T, Q),
    "a desired one beside": table(("t", *NAMES, *WANTED), T, Q, -Q),
    "numbered": "time,name_0,name_1,position_0,position_1\n"
    + "".join(f"{t!r},arm_lift,base_turn,{b!r},{a!r}\n" for t, a, b in PAIRS),
    "ros header": "header.stamp.secs,header.stamp.nsecs,base_turn,arm_lift\n"
    + "".join(f"{1700000000 + int(t)},{round(t % 1 * 1e9)},{a!r},{b!r}\n" for t, a, b in PAIRS),
    "ns since 1970": "timestamp,base_turn,arm_lift\n"
    + "".join(f"{1700000000123456789 + round(t * 1e9)},{a!r},{b!r}\n" for t, a, b in PAIRS),
}


WORDS = [f"field.{kind}{i}" for kind in ("name", "position") for i in (0, 1)]
STAMPS = [1700000000123456789 + round(t * 1e9) for t in T.tolist()]
DIALECTS |= {
    "headers of joints and units": table(("t", "j1_rad", "j2_rad"), T, Q),
    "numbered axes": table(("t", "A1", "A2"), T, Q),
    "numbered axes in degrees": table(("t", "A1 [deg]", "A2 [deg]"), T, np.degrees(Q)),
    "one row a joint": "time,joint,position,effort\n"
    + "".join(f"{t!r},base_turn,{a!r},1\n{t!r},arm_lift,{b!r},2\n" for t, a, b in PAIRS),
    "rostopic echo -p": ",".join(["%time", "field.header.seq", "field.header.stamp", *WORDS])
    + "\n"
    + "".join(
        f"{stamp + 5_000_000},{i},{stamp},arm_lift,base_turn,{b!r},{a!r}\n"
        for i, (stamp, (_, a, b)) in enumerate(zip(STAMPS, PAIRS, strict=True))
    ),
}


def noisy(t, seed=5):
    rng = np.random.default_rng(seed)
    return swung(t) + 1e-5 * rng.normal(size=(t.size, 2))


SCENE = """pinfric: 1
robot: {urdf: "example-robot-data:ur_description/urdf/ur10_robot.urdf"}
friction:
  shoulder_lift_joint: {coulomb: {static: 12.0, kinetic: 10.0}, viscous: 8.0}
  elbow_joint: {coulomb: {static: 6.0, kinetic: 5.0}, viscous: 6.0}
"""


#: A UR10 takes a part at A and puts it down at B: stops with holds, and two that it passes.
WAY = """pinfric_trajectory: 1
profile: PROFILE
sample_rate: RATE
points:
  - {q: [0.0024, -1.893, 1.7908, -1.4686, -1.5708, 0.0024], hold: 0.2}
  - {q: [-0.7912, -1.451, 1.6533, -1.7731, -1.5708, -0.7912], duration: 1.0}
  - {q: [-0.7912, -1.2357, 1.9542, -2.2893, -1.5708, -0.7912], duration: 0.6, hold: 0.4}
  - {q: [-0.7912, -1.451, 1.6533, -1.7731, -1.5708, -0.7912], duration: 0.6}
  - {q: [0.7796, -1.451, 1.6533, -1.7731, -1.5708, 0.7796], duration: 1.4}
  - {q: [0.7796, -1.2357, 1.9542, -2.2893, -1.5708, 0.7796], duration: 0.6, hold: 0.4}
  - {q: [0.0024, -1.893, 1.7908, -1.4686, -1.5708, 0.0024], duration: 1.2, hold: 0.2}
"""


ARM = lump(1.0, [0.3, 0, 0])


#: Drives whose efforts are more than rounding beside the others'.
LOADED = slice(0, 4)


class Truth:
    """A planned pick-and-place, its peak efforts, and an encoder's log of it."""

    def __init__(self, folder, profile):
        self.folder, self.profile = folder, profile
        (folder / "ur10.yaml").write_text(SCENE)
        self.scene = pf.load_scene(folder / "ur10.yaml")
        self.plans = {rate: self._plan(rate) for rate in (500, 1000, 4000)}
        result = pf.inverse_dynamics(self.scene, self.plans[4000])
        self.peak = peaks(result)

    def _plan(self, rate):
        path = self.folder / f"{self.profile}_{rate}.yaml"
        path.write_text(WAY.replace("PROFILE", self.profile).replace("RATE", str(rate)))
        return pf.load_trajectory(path, self.scene)

    def log(self, rate, kind):
        """The times and positions that an encoder and a logger make of the plan."""
        seeded, plan, fine = np.random.default_rng(7), self.plans[rate], self.plans[4000]
        t, q = plan.t, plan.q
        white = seeded.normal(size=q.shape)
        jitter = 3e-4 * seeded.normal(size=t.size)
        if kind in ("1e-5", "2e-5"):
            return t, q + float(kind) * white
        if kind in ("20 bit", "16 bit"):
            count = 2.0 * np.pi / 2 ** int(kind[:2])
            return t, np.round(q / count) * count
        if kind == "wrapped":
            wrapped = q + 1e-5 * white
            wrapped[:, 0] = np.angle(np.exp(1j * (wrapped[:, 0] + np.pi)))
            return t, wrapped
        if kind == "stamps jitter":
            return t + jitter, q + 1e-5 * white
        if kind in ("sleep loop", "stalls"):
            return self._wandering(seeded, rate, kind)
        assert kind == "samples jitter"
        at = np.clip(t + jitter, 0.0, t[-1])
        late = np.column_stack([np.interp(at, fine.t, x) for x in fine.q.T])
        return t, late + 1e-5 * white

    def _wandering(self, seeded, rate, kind):
        """The log of a loop that sleeps for a period and works for a while, or is held up."""
        fine, step = self.plans[4000], 1.0 / rate
        steps = step * (1.0 + 0.1 * seeded.exponential(size=round(fine.t[-1] / step)))
        if kind == "stalls":  # 3 to 8 periods late, and then two rows in a hurry
            late = np.flatnonzero(seeded.random(steps.size - 2) < 0.01)
            steps[late] = step * seeded.uniform(3.0, 8.0, late.size)
            steps[late + 1] = steps[late + 2] = 0.1 * step
        t = np.concatenate(([0.0], np.cumsum(steps)))
        t = t[t <= fine.t[-1]]
        q = np.column_stack([np.interp(t, fine.t, x) for x in fine.q.T])
        return t, q + 1e-5 * seeded.normal(size=q.shape)


def peaks(result):
    return np.maximum(np.abs(result.effort_lower), np.abs(result.effort_upper)).max(axis=0)


def write_csv(path, t, names, columns, form="%.12g"):
    np.savetxt(
        path,
        np.column_stack((t, columns)),
        delimiter=",",
        header=",".join(["t", *names]),
        comments="",
        fmt=form,
    )
    return path
