"""A replay's page in a real browser: what it draws at which time, and its controls; names."""

import io
import json
import shutil
import time

import numpy as np
import pinocchio as pin
import pytest
from builders import chain

import pinfric as pf
from pinfric.show.pages.stop import stop_page
from pinfric.show.replay.markers import COLORS
from pinfric.show.replay.stage import SEGMENTS, SIDES

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
#: What the tests ask the page: objects of the scene tree, texts, and time in a test's hands.
ASKED = """
window.node = (path) => replay.viewer.scene_tree.find(['meshcat', ...path.split('/')]).object;
window.site = (name) => node('world/2 joint_12/site joint_12/' + name);
window.ring = () => '#' + site('ring/<object>').material.color.getHexString().toUpperCase();
window.arc = (end) => site('arc_' + end).visible
  ? site('arc_' + end + '/body/<object>').geometry.drawRange.count : 0;
window.texts = (what) => [...document.querySelectorAll(what)].map((x) => x.innerText.trim());
window.row = (title) => [...document.querySelectorAll('.row')]
  .find((x) => x.querySelector('.name').title.startsWith(title)).innerText.split('\\n').pop();
window.along = () => {
  replay.viewer.scene.updateMatrixWorld(true);
  const T = MeshCat.THREE, turn = (x) => x.getWorldQuaternion(new T.Quaternion());
  return new T.Vector3(0, 0, 1).applyQuaternion(turn(site('force')))
    .applyQuaternion(turn(node('world')).invert()).toArray();
};
window.own_clock = () => {
  const draws = window.requestAnimationFrame;
  let clock = performance.now(), tick = null;
  performance.now = () => clock;
  window.requestAnimationFrame = (f) => f.name === 'tick' ? ((tick = f), 0) : draws.call(window, f);
  window.frame = (ms) => { if (tick) tick(clock += ms); return tick ? replay.time() : null; };
};
"""


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
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def opened(browser):
    """Opens a file: the browser with its page, ready for questions."""
    driver = browser

    def load(file):
        driver.get(file.as_uri())
        wait_for(driver, "document.body.dataset.ready")
        driver.execute_script(ASKED)
        entries = [json.loads(x["message"])["message"] for x in driver.get_log("performance")]
        sent = [x["params"] for x in entries if x["method"] == "Network.requestWillBeSent"]
        own = [x for x in sent if x["documentURL"] == driver.current_url]
        assert {x["request"]["url"] for x in own} == {driver.current_url}  # it fetches nothing
        assert [x for x in driver.get_log("browser") if x["level"] != "INFO"] == []
        return driver

    return load


def wait_for(page, script):
    deadline = time.monotonic() + 60
    while not page.execute_script(f"return {script}"):
        assert time.monotonic() < deadline, script
        time.sleep(0.05)


@pytest.fixture(scope="module")
def three_link(opened, tmp_path_factory):
    """An arm on worms that hold by themselves, within limits; friction at its second joint."""
    worm = {"ratio": 30.0, "efficiency": 0.4, "back_efficiency": -0.2, "no_load_torque": 0.01}
    scene = pf.load_scene("three_link")
    geared = scene.with_(
        actuators=[{"joint": drive.name, "transmission": worm} for drive in scene.drives]
    )
    result = pf.inverse_dynamics(geared, pf.load_trajectory("three_link", geared))
    limits = {drive.name: {"velocity": 1.0, "peak_torque": 1e3} for drive in scene.drives}
    file = tmp_path_factory.mktemp("page") / "three_link.html"
    return geared, result, opened(pf.replay(geared, result, html=file, limits=limits).html)


@pytest.mark.parametrize(
    ("t", "state", "gears", "limits"),
    [
        (0.1, "sticking", ("1", "12"), ()),
        (0.5, "sliding", (), ("1",)),
        (1.0, "sticking", ("1", "12", "23"), ()),
        (1.75, "near", ("1", "12", "23"), ()),
        (1.801, "sliding", (), ()),
    ],
)
def test_what_the_page_says(three_link, t, state, gears, limits):
    _, result, page = three_link
    friction = result.friction_upper[np.searchsorted(result.t, t), 0]
    assert page.execute_script(
        "replay.seek(arguments[0]);return [replay.state('joint_12'), ring(), site('disc').visible]",
        t,
    ) == [state, COLORS[state], state != "sliding"]
    rows = dict(
        row.split("\n") for row in page.execute_script("return texts('.row')") if "\n" in row
    )
    assert rows == {
        "joint_12": f"{'±' * (state != 'sliding')}{friction:.2f} N m".replace(
            "-", "\N{MINUS SIGN}"
        ),
        **{f"⚙ joint_{name}": "holds by itself" for name in gears},
        **{f"▲ joint_{name}": "joint speed exceeded" for name in limits},
    }
    legend = page.execute_script("return texts('#legend')[0]")
    assert "gear holds by itself: its motor needs no torque" in legend
    assert "a drive at one of its limits" in legend
    page.execute_script("document.querySelectorAll('#intervals button')[1].click()")
    assert page.execute_script("return [replay.time(), ...texts('#count')]") == [1.0, "3"]


@pytest.mark.parametrize("sample", [500, 1300, 2200])
def test_the_slider_moves_the_robot_its_arcs_and_its_arrow(three_link, sample):
    scene, result, page = three_link
    found = page.execute_script(
        "const s = document.getElementById('slider'); s.value = arguments[0];"
        "s.dispatchEvent(new Event('input')); const joint = node('world/2 joint_12');"
        "const force = document.getElementById('show-forces'); if (!force.checked) force.click();"
        "return [replay.time(), [...joint.position.toArray(), ...joint.quaternion.toArray()],"
        "along(), [arc('plus'), arc('minus')]]",
        float(result.t[sample]),
    )
    data = scene.model.createData()
    pin.forwardKinematics(scene.model, data, result.states.q[sample])
    force = data.oMi[2].rotation @ result.wrench[sample, 0, :3]  # in the world
    assert found[0] == pytest.approx(result.t[sample], abs=1e-12)
    assert found[1] == pytest.approx(pin.SE3ToXYZQUAT(data.oMi[2]), abs=2e-4)
    assert found[2] == pytest.approx(force / np.linalg.norm(force), abs=1e-3)
    most = np.abs([result.friction_lower, result.friction_upper]).max()
    ends = result.friction_upper[sample, 0], -result.friction_lower[sample, 0]
    assert np.array(found[3]) / (SEGMENTS * SIDES * 6) == pytest.approx(
        np.maximum(ends, 0) / most, abs=0.02
    )


def test_it_plays_in_real_time_and_stops_at_the_end(three_link):
    """A busy machine draws late, not slowly."""
    _, result, page = three_link
    play = "document.getElementById('play').click();"
    page.execute_script(f"document.getElementById('loop').checked = false; replay.seek(0); {play}")
    wait_for(page, "replay.time() > 0.2")  # the browser's own frames move it
    page.execute_script(f"{play} own_clock()")
    wait_for(page, "frame(0) !== null")
    assert page.execute_script("return frame(500) === frame(500)")  # it pauses
    page.execute_script(f"replay.seek(0); {play}")
    passed = np.cumsum([1, 16, 17, 250, 16, 900, *[40] * 60])
    shown = [page.execute_script(f"return frame({ms})") for ms in np.diff(passed, prepend=0)]
    assert shown == pytest.approx(np.minimum(passed / 1000, result.t[-1]))


def test_the_robot_and_its_sticking_are_seen_in_the_pixels(three_link):
    from PIL import Image

    page = three_link[2]

    def colours(t):
        page.execute_script(f"replay.seek({t})")
        time.sleep(0.1)
        pane = page.find_element("id", "pane").screenshot_as_png
        return np.asarray(Image.open(io.BytesIO(pane)).convert("RGB")).reshape(-1, 3).T.astype(int)

    red, green, blue = colours(1.2)
    orange = ((red > 190) & (abs(green - 158) < 40) & (blue < 60)).sum()
    for one, other, third in ((red, green, blue), (green, red, blue), (blue, red, green)):
        assert ((one > other + 25) & (one > third + 15)).sum() > 300  # three links
    red, green, blue = colours(1.9)
    assert orange > 300 > 10 * ((red > 190) & (abs(green - 158) < 40) & (blue < 60)).sum()


NAMES = [
    '<b>&" onclick="x',
    "<img src=x onerror=alert(1)>",
    "</script>a/b",
    "<object>",
    "constructor",  # of JavaScript's own objects
    "__proto__",
    "</script>a|b",  # beside a/b: a node of its own
    "a\nb",
    "..",
    "{{7*7}}",
    "n" * 300,
    "\N{RIGHT-TO-LEFT OVERRIDE}\N{HEBREW LETTER ALEF}",
    "関節\u2028\U0001f9be",
    " ",
]


def test_names_are_text_whatever_is_in_them(opened, tmp_path):
    link = pin.JointModelRY(), pin.Inertia.FromBox(1.0, 0.3, 0.1, 0.1), [0.3, 0.0, 0.0]
    model = chain(*((name, *link) for name in NAMES))
    scene = pf.Scene(model, friction={name: {"viscous": 0.1} for name in NAMES})
    v = np.ones((51, len(NAMES)))
    result = pf.inverse_dynamics(scene, 0 * v, v, 0 * v, t=np.linspace(0.0, 1.0, 51))
    page = opened(pf.replay(scene, result, html=tmp_path / "names.html").html)
    titles, labels, elements, inside = page.execute_script(
        "const all = (x) => [...document.querySelectorAll(x)], labels = all('#labels span');"
        "const box = document.getElementById('pane').getBoundingClientRect();"
        "return [all('.row .name').map((x) => x.title), labels.map((x) => x.textContent),"
        "all('#app b, #app img, [onclick]').length, labels.every((x) => {"
        "const r = x.getBoundingClientRect(); return r.left >= box.left && r.right <= box.right &&"
        "r.top >= box.top && r.bottom <= box.bottom; })]"
    )
    assert (titles, labels, elements, inside) == (NAMES, NAMES, 0, True)
    assert page.execute_script("return document.documentElement.scrollWidth - innerWidth") <= 0


def test_names_of_a_report_are_text_and_keep_its_width(browser, tmp_path):
    brake = {"torque": 20.0, "engage_time": 0.02}
    drive = {"ratio": 1.0, "rotor_inertia": 0.01, "brake": brake}
    names = (NAMES[1], NAMES[10])
    scene = pf.Scene(
        chain(*((name, pin.JointModelRZ(), pin.Inertia.FromBox(1, 1, 1, 1)) for name in names)),
        actuators=[{"joint": name, "transmission": drive} for name in names],
        stops={"category": 0, "reaction_time": 0.01},
    )
    t = np.linspace(0.0, 1.0, 9)
    v = np.outer(np.sin(np.pi * t), [1.0, 1.0])
    a = np.pi * np.outer(np.cos(np.pi * t), [1.0, 1.0])
    motion = pf.Trajectory.from_arrays(scene, t, (1.0 - a / np.pi) / np.pi, v, a)
    (tmp_path / "stops.html").write_text(stop_page(pf.stop(scene, motion)), encoding="utf-8")
    browser.get((tmp_path / "stops.html").as_uri())
    found = browser.execute_script(
        "const all = (x) => [...document.querySelectorAll(x)];"
        "return [all('nav a').map((x) => x.textContent), all('img, [onerror]').length,"
        "document.documentElement.scrollWidth - innerWidth]"
    )
    assert found[:2] == [list(names), 0]
    assert found[2] <= 0
