"""Replay pages in a real browser: what it draws at which time, and what its controls do."""

from __future__ import annotations

import dataclasses
import io
import json
import shutil
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, example

import pinfric as pf
from pinfric.model.robot import example_robot_data
from pinfric.show.replay.markers import COLORS
from pinfric.show.replay.stage import SEGMENTS, SIDES

ROBOTS = Path(__file__).parents[2] / "robots"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")
FLAGS = (
    "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader "
    "--disable-background-networking --disable-component-update --disable-sync --no-first-run "
    "--window-size=1000,700"
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.skipif(
        CHROMIUM is None or DRIVER is None,
        reason="no browser: apt install chromium chromium-driver",
    ),
]


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    webdriver = pytest.importorskip("selenium.webdriver", reason="pip install selenium")
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS.split(), f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    driver.set_page_load_timeout(60)
    yield driver
    driver.quit()


class Page:
    """A page in the browser, and what its scene tree says."""

    def __init__(self, browser, file=None):
        self.browser = browser
        if file is not None:
            browser.get_log("browser")
            browser.get_log("performance")
            browser.get(Path(file).absolute().as_uri())
        deadline = time.monotonic() + 60
        while not self.run("return document.body.dataset.ready"):
            assert time.monotonic() < deadline, (self.complaints(), self.text("#loading"))
            time.sleep(0.05)

    def run(self, script, *arguments):
        return self.browser.execute_script(script, *arguments)

    def complaints(self):
        return [x["message"] for x in self.browser.get_log("browser") if x["level"] != "INFO"]

    def requests(self):
        """Addresses that the page asked for since it was loaded, itself among them."""
        entries = [json.loads(x["message"])["message"] for x in self.browser.get_log("performance")]
        sent = [x["params"] for x in entries if x["method"] == "Network.requestWillBeSent"]
        return {x["request"]["url"] for x in sent if x["documentURL"] == self.browser.current_url}

    def text(self, selector):
        return self.run("return document.querySelector(arguments[0]).innerText", selector)

    def seek(self, t):
        self.run("replay.seek(arguments[0])", float(t))

    def node(self, path, what):
        """A property of an object of meshcat's scene tree."""
        return self.run(
            "return replay.viewer.scene_tree.find(['meshcat', ...arguments[0].split('/')])"
            f".object.{what}",
            path,
        )

    def ring(self, joint):
        """(colour of a marker, whether its disc is seen)."""
        marker = f"world/{joint}/site {joint}"
        color = self.node(f"{marker}/ring/<object>", "material.color.getHexString()")
        return f"#{color.upper()}", self.node(f"{marker}/disc", "visible")

    def place(self, joint):
        position = self.node(f"world/{joint}", "position.toArray()")
        return np.array(position + self.node(f"world/{joint}", "quaternion.toArray()"))

    def pixels(self):
        """(height, width, 3) of the 3D view."""
        from PIL import Image
        from selenium.webdriver.common.by import By

        pane = self.browser.find_element(By.ID, "pane")
        return np.asarray(Image.open(io.BytesIO(pane.screenshot_as_png)).convert("RGB"))


@pytest.fixture
def three_link(browser, three_link_page):
    scene, result, file = three_link_page
    if browser.current_url == file.as_uri():  # loaded by the test before
        return scene, result, Page(browser)
    return scene, result, Page(browser, file)


@pytest.fixture(scope="module")
def three_link_page(tmp_path_factory):
    scene, trajectory = example(ROBOTS / "three_link.yaml", ROBOTS / "three_link.waypoints.yaml")
    result = pf.inverse_dynamics(scene, trajectory)
    shown = pf.replay(scene, result, html=tmp_path_factory.mktemp("page") / "three_link.html")
    return scene, result, shown.html


def solved(name):
    scene, trajectory = example(ROBOTS / f"{name}.yaml", ROBOTS / f"{name}.waypoints.yaml")
    return scene, pf.inverse_dynamics(scene, trajectory)


def placement(scene, q, joint):
    data = scene.model.createData()
    pin.forwardKinematics(scene.model, data, q)
    return pin.SE3ToXYZQUAT(data.oMi[scene.model.getJointId(joint)])


def test_page_loads_without_complaints_and_shows_the_robot(three_link):
    _, _, page = three_link
    page.seek(0.0)
    assert page.complaints() == []
    pixels = page.pixels().reshape(-1, 3).astype(int)
    assert len(np.unique(pixels // 16, axis=0)) > 50
    red, green, blue = pixels.T  # the three links' colours, some hundred pixels each
    for one, other, third in ((red, green, blue), (green, red, blue), (blue, red, green)):
        assert ((one > other + 25) & (one > third + 15)).sum() > 300


def test_marker_has_the_sticking_colour_inside_an_interval_and_not_outside(three_link):
    _, result, page = three_link
    interval = result.stick_intervals()[1]
    middle = 0.5 * (interval.start + interval.end)
    for t, state in (
        (interval.start - 1e-3, "sliding"),
        (interval.start, "sticking"),
        (middle, "sticking"),
        (interval.end - 0.01, "near"),
        (interval.end, "near"),
        (interval.end + 1e-3, "sliding"),
    ):
        page.seek(t)
        assert page.ring("joint_12") == (COLORS[state], state != "sliding"), t
        assert page.run("return replay.state('joint_12')") == state


def test_sticking_is_seen_in_the_pixels(three_link):
    _, result, page = three_link
    interval = result.stick_intervals()[1]

    def orange(t):
        page.seek(t)
        time.sleep(0.1)
        red, green, blue = page.pixels().reshape(-1, 3).astype(int).T
        return int(((red > 190) & (abs(green - 158) < 40) & (blue < 60)).sum())

    assert orange(interval.start + 0.2) > 300 > 10 * orange(interval.end + 0.1)


def test_slider_moves_the_robot(three_link):
    scene, result, page = three_link
    for sample in (600, 1400, 2600):
        t = float(result.t[sample])
        page.run(
            "const s = document.getElementById('slider'); s.value = arguments[0];"
            "s.dispatchEvent(new Event('input'))",
            t,
        )
        assert page.run("return replay.time()") == pytest.approx(t, abs=1e-12)
        for joint in scene.joint_names:
            expected = placement(scene, result.states.q[sample], joint)
            np.testing.assert_allclose(page.place(joint), expected, atol=2e-4)
        assert page.text("#clock").startswith(f"{t:.3f} s")


def test_interval_in_the_list_goes_there_and_is_marked(three_link):
    _, result, page = three_link
    page.seek(0.5)
    assert page.text("#count") == "3"
    page.run("document.querySelectorAll('#intervals button')[1].click()")
    assert page.run("return replay.time()") == result.stick_intervals()[1].start
    marked = "return [...document.querySelectorAll('#intervals button')].map(b => b.className)"
    assert page.run(marked) == ["", "now", ""]


def test_arcs_are_as_long_as_the_friction(three_link):
    _, result, page = three_link

    def lengths(sample):
        page.seek(result.t[sample])
        return [
            page.node(f"{arc}/body/<object>", "geometry.drawRange.count")
            * page.node(arc, "visible")
            for arc in (f"world/joint_12/site joint_12/arc_{end}" for end in ("plus", "minus"))
        ]

    most = np.abs([result.friction_lower, result.friction_upper]).max()
    whole = SEGMENTS * SIDES * 6
    for sample in (500, 1300, 2200):
        plus, minus = lengths(sample)
        up, low = result.friction_upper[sample, 0], result.friction_lower[sample, 0]
        assert plus / whole == pytest.approx(max(up, 0) / most, abs=0.02)
        assert minus / whole == pytest.approx(max(-low, 0) / most, abs=0.02)
    assert min(lengths(1300)) > 0  # at rest: both ways


def test_force_arrow_points_where_the_parent_pushes(three_link):
    scene, result, page = three_link
    page.run("document.getElementById('show-forces').click()")
    sample = 2200
    page.seek(result.t[sample])
    assert page.node("world/joint_12/site joint_12/force", "visible")
    arrow = page.run(
        "const n = replay.viewer.scene_tree.find(['meshcat', 'world', 'joint_12', 'site joint_12',"
        "'force']).object; replay.viewer.scene.updateMatrixWorld(true);"
        "const w = replay.viewer.scene_tree.find(['meshcat', 'world']).object;"
        "const T = MeshCat.THREE, z = new T.Vector3(0, 0, 1);"
        "z.applyQuaternion(n.getWorldQuaternion(new T.Quaternion()));"
        "return z.applyQuaternion(w.getWorldQuaternion(new T.Quaternion()).invert()).toArray()"
    )
    data = scene.model.createData()
    pin.forwardKinematics(scene.model, data, result.states.q[sample])
    force = data.oMi[2].rotation @ result.wrench[sample, 0, :3]  # in the world
    np.testing.assert_allclose(arrow, force / np.linalg.norm(force), atol=1e-3)
    page.run("document.getElementById('show-forces').click()")


#: The page's own clock and frames in the hands of a test: `frame(ms)` lets time pass and draws.
OWN_CLOCK = """
const draws = window.requestAnimationFrame;
let clock = performance.now(), tick = null;
performance.now = () => clock;
window.requestAnimationFrame = (f) => f.name === "tick" ? ((tick = f), 0) : draws.call(window, f);
window.frame = (ms) => { if (tick) tick(clock += ms); return tick ? replay.time() : null; };
window.let_go = () => {
  delete performance.now;
  window.requestAnimationFrame = draws;
  draws.call(window, tick);
};
"""


def wait_for(page, script):
    deadline = time.monotonic() + 30
    while not page.run(script):
        assert time.monotonic() < deadline, script
        time.sleep(0.05)


def test_it_plays_in_real_time_and_stops_at_the_end(three_link):
    _, result, page = three_link
    page.seek(0.0)
    page.run("document.getElementById('loop').checked = false")
    play = "document.getElementById('play').click()"
    page.run(play)
    wait_for(page, "return replay.time() > 0.2")  # the browser's own frames move it
    page.run(play)  # pause
    page.run(OWN_CLOCK)
    try:
        wait_for(page, "return frame(0) !== null")
        at = page.run("return frame(500)")
        assert page.run("return frame(500)") == at  # it pauses
        page.seek(0.0)
        page.run(play)
        passed = np.cumsum([1, 16, 17, 250, 16, 900])  # a busy machine draws late, not slowly
        shown = [page.run(f"return frame({ms})") for ms in np.diff(passed, prepend=0)]
        assert shown == pytest.approx(passed / 1000)
        passed = 1.2 + 0.04 * np.arange(1, 60)
        shown = [page.run("return frame(40)") for _ in passed]
        assert shown == pytest.approx(np.minimum(passed, result.t[-1]))
        assert shown[-1] == result.t[-1]
    finally:
        page.run("let_go()")


def test_friction_of_a_ball_is_an_arc_about_its_slip(browser, tmp_path):
    scene, result = solved("delta")
    aside = [loop.model_copy(update={"axis": (1.0, 0.0, 0.0)}) for loop in scene.loops]
    scene = dataclasses.replace(scene, loops=aside)  # means nothing to a ball but to its marker
    result = dataclasses.replace(result, scene=scene)
    page = Page(browser, pf.replay(scene, result, html=tmp_path / "delta.html").html)
    assert page.complaints() == []
    assert page.requests() == {browser.current_url}
    sample = len(result.t) // 3
    page.seek(result.t[sample])
    s = scene.site_names.index("ball_1")
    assert not result.sticking[sample, s]
    arc = page.run(
        "const find = (p) => replay.viewer.scene_tree.find(['meshcat', ...p.split('/')]).object;"
        "replay.viewer.scene.updateMatrixWorld(true); const T = MeshCat.THREE;"
        "const [path] = JSON.parse(document.getElementById('data').textContent).sites"
        ".filter((x) => x.name === 'ball_1').map((x) => x.path);"
        "const arc = find(path + '/arc_minus'), turn = arc.getWorldQuaternion(new T.Quaternion());"
        "const back = find('world').getWorldQuaternion(new T.Quaternion()).invert();"
        "return [...new T.Vector3(0, 0, 1).applyQuaternion(turn).applyQuaternion(back).toArray(),"
        "arc.visible, find(path + '/arc_plus').visible]"
    )
    data = scene.model.createData()
    loop = scene.loops[scene.sites[s].pair]
    pin.forwardKinematics(scene.model, data, result.states.q[sample], result.states.v[sample])
    spins = []
    for side in (loop.a, loop.b):
        joint = scene.model.frames[scene.model.getFrameId(side.link)].parentJoint
        spins.append(data.oMi[joint].rotation @ data.v[joint].angular)
    slip = spins[1] - spins[0]
    np.testing.assert_allclose(arc[:3], slip / np.linalg.norm(slip), atol=1e-3)
    assert arc[3:] == [True, False]  # against the slip


def test_friction_along_a_slide_is_seen_through_the_body_that_slides(browser, tmp_path):
    scene, result = solved("drawer")
    page = Page(browser, pf.replay(scene, result, html=tmp_path / "drawer.html").html)
    assert "cylinder or force that drives" in page.text("#legend")
    page.run("document.getElementById('show-names').click()")
    page.run("replay.viewer.camera.zoom = 2; replay.viewer.camera.updateProjectionMatrix()")

    def orange(shown):
        page.run(
            "if (replay.show.friction !== arguments[0])"
            "document.getElementById('show-friction').click()",
            shown,
        )
        page.seek(1.0)
        time.sleep(0.1)
        red, green, blue = page.pixels().reshape(-1, 3).astype(int).T
        return int(((red > 190) & (abs(green - 158) < 40) & (blue < 60)).sum())

    assert orange(True) > orange(False) + 200  # two arrows, at rest both ways


def test_jammed_joint_has_its_colour_and_no_friction(browser, tmp_path):
    from show.replay.test_markers import jammed_drawer

    scene, result = jammed_drawer()
    page = Page(browser, pf.replay(scene, result, html=tmp_path / "jammed.html").html)
    page.seek(0.5)
    assert page.complaints() == []
    assert page.ring("slide") == (COLORS["jammed"], True)
    assert page.text(".row .value").startswith("none")
    assert "jammed" in page.text("#legend")
    for arrow in ("arc_plus", "arc_minus"):
        assert page.node(f"world/slide/site slide/{arrow}", "visible") is False


def test_gears_that_hold_have_rows(browser, tmp_path):
    scene = pf.load_scene(ROBOTS / "three_link.yaml")
    worm = {"ratio": 30.0, "efficiency": 0.4, "back_efficiency": -0.2, "no_load_torque": 0.01}
    names = [drive.name for drive in scene.drives]
    geared = scene.with_(actuators=[{"joint": name, "transmission": worm} for name in names])
    result = pf.inverse_dynamics(geared, pf.load_trajectory("three_link.waypoints.yaml", geared))
    page = Page(browser, pf.replay(geared, result, html=tmp_path / "gears.html").html)
    assert page.complaints() == []
    assert "gear holds by itself: its motor needs no torque" in page.text("#legend")
    gears = (
        "[...document.querySelectorAll('.row .name')].filter(x => x.title.startsWith('gear of'))"
    )
    assert page.run(f"return {gears}.map(x => x.title)") == [f"gear of {name}" for name in names]
    assert page.run(f"return {gears}.map(x => x.innerText[0])") == ["⚙"] * len(names)
    for t, held in ((0.1, {"joint_1", "joint_12"}), (0.5, set()), (1.7, set(names))):
        page.seek(t)
        words = page.run(f"return {gears}.map(x => x.parentNode.querySelector('.value').innerText)")
        told = {n for n, text in zip(names, words, strict=True) if text == "holds by itself"}
        assert told == held


def test_limits_have_rows_that_say_which_one_holds_back(browser, tmp_path):
    from show.replay.test_replay import pushed

    limits = {"j": {"peak_torque": 4.01, "velocity": 2.0}}
    page = Page(browser, pf.replay(*pushed(), html=tmp_path / "limits.html", limits=limits).html)
    assert page.complaints() == []
    assert "a drive at one of its limits" in page.text("#legend")
    for t, words in (
        (0.5, "peak torque"),
        (1.5, "joint speed"),
        (2.3, "peak torque exceeded"),
        (2.9, ""),
    ):
        page.seek(t)
        assert page.text(".row .name").strip() == "▲ j"
        assert page.text(".row .value").strip() == words
    green, red = page.run(
        "const c = document.querySelector('.row canvas'), x = c.getContext('2d');"
        "return [0.5, 2.3].map((t) => [...x.getImageData(c.width * t / 3, 9, 1, 1).data])"
    )
    assert green[:3] == [0x00, 0x9E, 0x73]
    assert red[:3] == [0xC2, 0x18, 0x5B]


def test_names_are_text_whatever_is_in_them(browser, tmp_path):
    names = ['<b>&" onclick="x', "<img src=x onerror=alert(1)>", "</script>a/b", "<object>"]
    link = pin.JointModelRY(), pin.Inertia.FromBox(1.0, 0.3, 0.1, 0.1), [0.3, 0.0, 0.0]
    model = chain(*((name, *link) for name in names))
    scene = pf.Scene(model=model, friction={name: {"viscous": 0.1} for name in names})
    t = np.linspace(0.0, 1.0, 51)
    v = np.ones((51, 4))
    result = pf.inverse_dynamics(scene, t[:, None] * v, v, 0 * v, t=t)
    page = Page(browser, pf.replay(scene, result, html=tmp_path / "names.html").html)
    page.seek(0.5)
    assert page.complaints() == []
    titles = "return [...document.querySelectorAll('.row .name')].map((x) => x.title)"
    assert page.run(titles) == names
    labels = "return [...document.querySelectorAll('#labels span')].map((x) => x.textContent)"
    assert page.run(labels) == names
    assert page.run("return document.querySelectorAll('#app b, #app img, [onclick]').length") == 0
    inside = page.run(
        "const box = document.getElementById('pane').getBoundingClientRect();"
        "return [...document.querySelectorAll('#labels span')].every((x) => {"
        "const r = x.getBoundingClientRect(); return r.left >= box.left && r.right <= box.right &&"
        "r.top >= box.top && r.bottom <= box.bottom; })"
    )
    assert inside


def test_labels_stay_inside_the_view(three_link):
    page = three_link[2]
    page.seek(0.0)
    for target in ("0, 3, 0", "0, -3, 0", "2, 0, -2", "-2, 0, 2"):  # above, below, right, left
        page.run(f"replay.viewer.controls.target.set({target}); replay.viewer.controls.update();")
        time.sleep(0.3)
        box, label = (
            page.run(f"return document.querySelector('{what}').getBoundingClientRect().toJSON()")
            for what in ("#pane", "#labels span")
        )
        assert box["top"] <= label["top"] < label["bottom"] <= box["bottom"]
        assert box["left"] <= label["left"] < label["right"] <= box["right"]
    page.run("document.getElementById('fit').click()")


def test_uneven_samples_are_shown_at_their_times(browser, tmp_path):
    scene = pf.load_scene(ROBOTS / "three_link.yaml")
    t = np.concatenate([np.linspace(0, 1, 41), np.linspace(1, 1.01, 200)[1:], [1.1, 1.2, 1.3]])
    q = np.sin(t)[:, None] * np.ones(3)
    v = np.cos(t)[:, None] * np.ones(3)
    shown = pf.replay(scene, pf.inverse_dynamics(scene, q, v, -q, t=t), html=tmp_path / "t.html")
    page = Page(browser, shown.html)
    for at in (0.31, 1.005, 1.16):
        page.seek(at)
        expected = placement(scene, np.sin(at) * np.ones(3), "joint_23")
        np.testing.assert_allclose(page.place("joint_23"), expected, atol=1e-3)


def test_sticks_shorter_than_a_frame_are_listed_and_shown(browser, tmp_path):
    scene = pf.load_scene(ROBOTS / "three_link.yaml")
    t = np.arange(0.0, 1.0, 1e-4)
    v = np.ones((len(t), 3))
    v[5000:5004, 1] = 0.0  # 0.3 ms of rest
    shown = pf.replay(
        scene, pf.inverse_dynamics(scene, 0 * v, v, 0 * v, t=t), html=tmp_path / "short.html"
    )
    page = Page(browser, shown.html)
    assert page.text("#intervals").split("\n")[-1] == "0.30 ms"
    assert "0.50000 \u2013 0.50030 s" in page.text("#intervals")
    page.seek(0.50015)
    assert page.ring("joint_12")[0] in (COLORS["sticking"], COLORS["near"])
    page.seek(0.5005)
    assert page.ring("joint_12")[0] == COLORS["sliding"]


def test_panda_with_meshes_and_box(browser, tmp_path):
    scene, trajectory = example(
        ROBOTS / "panda_pick_and_place.yaml", ROBOTS / "panda_pick_and_place.waypoints.yaml"
    )
    result = pf.inverse_dynamics(scene, trajectory)
    shown = pf.replay(scene, result, html=tmp_path / "panda.html")
    page = Page(browser, shown.html)
    assert page.complaints() == []
    carried = np.flatnonzero(result.states.attached[:, 0])
    for t, there in (
        (result.t[carried[0]] - 0.01, False),
        (result.t[carried[0]] + 0.01, True),
        (result.t[carried[-1]] + 0.01, False),
    ):
        page.seek(t)
        assert page.node("world/panda_joint7/payload box", "visible") is there
        for s, joint in enumerate(scene.site_names):
            near = [i for i in shown.stick_intervals if i.site == joint and i.start <= t <= i.end]
            sticks = bool(near)
            assert (page.ring(joint)[0] in (COLORS["sticking"], COLORS["near"])) is sticks, (s, t)


def test_robot_without_visuals_is_seen(browser, tmp_path):
    from builders import random_tree

    scene = pf.Scene(model=random_tree(3, joints=3, sliding=0.0))
    t = np.linspace(0.0, 1.0, 51)
    still = np.zeros((51, scene.model.nv))
    q = np.tile(pin.neutral(scene.model), (51, 1))
    shown = pf.replay(
        scene, pf.inverse_dynamics(scene, q, still, still, t=t), html=tmp_path / "tree.html"
    )
    page = Page(browser, shown.html)
    assert page.complaints() == []
    assert "no joint has friction" in page.text("#legend")
    red, _, blue = page.pixels().reshape(-1, 3).astype(int).T
    assert ((blue > red + 12) & (red < 190)).sum() > 2000  # boxes of equal inertia


def test_cylinder_reaches_from_link_to_link(browser, tmp_path):
    from show.replay.test_stage import boom

    scene = boom()
    t = np.linspace(0.0, 1.0, 51)[:, None]
    result = pf.inverse_dynamics(
        scene, 0.5 * np.sin(t) - 0.6, 0.5 * np.cos(t), -0.5 * np.sin(t), t=t[:, 0]
    )
    page = Page(browser, pf.replay(scene, result, html=tmp_path / "boom.html").html)
    assert page.complaints() == []
    page.seek(t[40, 0])
    at = "world/cylinder lift"
    begin = np.array(page.node(at, "position.toArray()"))
    turn = pin.Quaternion(np.array(page.node(at, "quaternion.toArray()"))).toRotationMatrix()
    end = begin + turn[:, 2] * page.node(f"{at}/rod", "scale.z")
    np.testing.assert_allclose(begin, [0.3, 0, 0], atol=1e-6)
    hinge = pin.SE3(pin.utils.rotate("y", 0.5 * np.sin(t[40, 0]) - 0.6), np.array([0, 0, 0.5]))
    np.testing.assert_allclose(end, hinge.act(np.array([0.7, 0, 0])), atol=1e-5)


@pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")  # of the robot's own file
def test_robot_of_48_joints_is_a_small_page_with_48_rows(browser, tmp_path):
    urdf = example_robot_data() / "tiago_description/robots/tiago.urdf"
    model = pin.buildModelFromUrdf(str(urdf))
    friction = {name: {"viscous": 0.05} for name in model.names[1:]}
    (tmp_path / "tiago.yaml").write_text(
        json.dumps({"pinfric": 1, "robot": {"urdf": str(urdf)}, "friction": friction})
    )
    scene = pf.load_scene(tmp_path / "tiago.yaml")
    t = np.linspace(0.0, 2.0, 401)
    v = 0.3 * np.sin(2 * t[:, None] + np.arange(scene.model.nv))
    q = np.array([pin.integrate(scene.model, pin.neutral(scene.model), 0.2 * x) for x in v])
    result = pf.inverse_dynamics(scene, q, v, np.gradient(v, t, axis=0), t=t)
    shown = pf.replay(scene, result, html=tmp_path / "tiago.html")
    assert len(shown.page) < 2.5e6
    page = Page(browser, shown.html)
    assert page.complaints() == []
    assert page.run("return document.querySelectorAll('.row .value').length") == 48
    page.seek(1.0)
    expected = placement(scene, q[200], "head_2_joint")
    np.testing.assert_allclose(page.place("head_2_joint"), expected, atol=2e-4)
