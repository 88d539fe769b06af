"""Make the pictures of README.md and guide: python notebooks/make_pictures.py [NAME ...]

    efforts          efforts of the README's main job, with their bands      (`pinfric inverse`)
    replay           the UR10 while some joints stick and others slide       (needs Chromium)
    work_precision   error against computing time of the simulation methods  (notebook 03)

They go to notebooks/pictures, cut down to 256 colours. Without names: all of them.
"""

from __future__ import annotations

import argparse
import base64
import io
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

import pinfric as pf

FOLDER = Path(__file__).parent
ROBOTS = FOLDER.parent / "robots"
SCENE = ROBOTS / "ur10_machine_tending.yaml"
TRAJECTORY = ROBOTS / "ur10_machine_tending.waypoints.yaml"
#: Which cell of the notebook draws the picture.
NOTEBOOK, TAG = FOLDER / "03_stick_slip.ipynb", "picture-work-precision"
#: When the replay is shown (s), and the size of its window (pixels).
MOMENT, WINDOW = 2.5, (1080, 880)
#: Widest picture (pixels): GitHub shows at most about 900.
WIDEST = 1080
CHROMIUM_FLAGS = (
    "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader "
    "--disable-background-networking --disable-component-update --disable-sync --no-first-run"
)


def efforts() -> Image.Image:
    """Return what `pinfric inverse --out` draws."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["inverse", str(SCENE), str(TRAJECTORY), "--out", folder]
        subprocess.run(
            [sys.executable, "-m", "pinfric.cli", *command], check=True, capture_output=True
        )
        return Image.open(io.BytesIO((Path(folder) / "efforts.png").read_bytes()))


def replay() -> Image.Image:
    """Return a frame of the replay page."""
    scene = pf.load_scene(SCENE)
    result = pf.inverse_dynamics(scene, pf.load_trajectory(TRAJECTORY, scene))
    return screenshot(pf.replay(scene, result, title="UR10, machine tending").page, MOMENT)


def screenshot(page: str, moment: float) -> Image.Image:
    """Return a frame of a replay page at a time (s), drawn by a browser."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    driver = shutil.which("chromedriver")
    if chromium is None or driver is None:
        raise SystemExit("replay: there is no browser here (apt install chromium chromium-driver)")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "replay.html"
        file.write_text(page, encoding="utf-8")
        options = webdriver.ChromeOptions()
        options.binary_location = chromium
        for flag in (*CHROMIUM_FLAGS.split(), f"--user-data-dir={folder}/profile"):
            options.add_argument(flag)
        browser = webdriver.Chrome(options=options, service=Service(driver))
        try:
            browser.set_window_size(*WINDOW)
            browser.get(f"{file.as_uri()}#t={moment}")
            deadline = time.monotonic() + 60
            while not browser.execute_script("return document.body.dataset.ready"):
                if time.monotonic() > deadline:
                    raise SystemExit("replay: the page does not get ready")
                time.sleep(0.1)
            time.sleep(1.0)  # the labels follow one frame later
            return Image.open(io.BytesIO(browser.get_screenshot_as_png()))
        finally:
            browser.quit()


def work_precision() -> Image.Image:
    """Return the figure of notebook 03, which is executed for it."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(NOTEBOOK, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=300, resources={"metadata": {"path": folder}}).execute()
    for cell in notebook.cells:
        if TAG in cell.metadata.get("tags", ()):
            for output in cell.outputs:
                if "image/png" in output.get("data", {}):
                    return Image.open(io.BytesIO(base64.b64decode(output.data["image/png"])))
    raise SystemExit(f"{NOTEBOOK}: no cell with the tag {TAG!r} draws a picture")


PICTURES: dict[str, Callable[[], Image.Image]] = {
    "efforts": efforts,
    "replay": replay,
    "work_precision": work_precision,
}


def small_png(picture: Image.Image, widest: int = WIDEST) -> bytes:
    """Return a small PNG: not too wide, few colours."""
    picture = picture.convert("RGB")
    if picture.width > widest:
        height = round(picture.height * widest / picture.width)
        picture = picture.resize((widest, height), Image.Resampling.LANCZOS)
    # rare colours count, too: a marker is small, and must keep its colour
    pixels = np.asarray(picture)
    colors, counts = np.unique(pixels.reshape(-1, 3), axis=0, return_counts=True)
    sample = np.repeat(colors, np.ceil(counts**0.5).astype(int), axis=0)
    palette = Image.fromarray(sample[None]).quantize(255, kmeans=2)
    number = np.array(picture.quantize(palette=palette, dither=Image.Dither.NONE))
    number[(pixels == 255).all(axis=2)] = 255  # paper stays white
    small = Image.fromarray(number, "P")
    used = palette.getpalette()[: 3 * 255]
    small.putpalette([*used, *[255] * (3 * 256 - len(used))])
    written = io.BytesIO()
    small.save(written, "PNG", optimize=True)
    return written.getvalue()


def save(name: str) -> None:
    """Write a picture of `PICTURES`."""
    path = FOLDER / "pictures" / f"{name}.png"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(small_png(PICTURES[name]()))
    print(f"wrote {path}, {path.stat().st_size / 1000:.0f} kB")


def main() -> None:
    """Make the pictures that the command line names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(PICTURES))
    names = parser.parse_args().names or list(PICTURES)
    for name in names:
        if name not in PICTURES:
            parser.error(f"there is no picture {name!r}; there are {', '.join(PICTURES)}")
    for name in names:
        save(name)


if __name__ == "__main__":
    main()
