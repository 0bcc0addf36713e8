"""Makes the pictures of the pages, on a simulated gripper: `make pictures`. Needs Chromium and EGL.

The page in a browser, `litegripctl watch`, the plot of a dump behind a fault, and MuJoCo's scene.
Look at them before they are committed: nothing compares them.
"""

import io
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import sleep

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright
from rich.console import Console

from litegrip_client import LiteGrip, LiteGripError
from litegrip_client.ctl.live import picture, scenes
from litegrip_client.ctl.main import main as litegripctl
from litegrip_client.line.connection import Connection
from litegrip_client.testing import SimulatedDaemon, simulated

IMAGES = Path(__file__).parent / "images"
OBJECT_MM = 40.0
WATCHED_STATES = 160
FILM = {"x": 0, "y": 0, "width": 1000, "height": 690}
FRAMES_A_SECOND = 10
COLORS = 64
FilmFrames = list[tuple[Image.Image, float]]


@contextmanager
def shown(daemon: SimulatedDaemon) -> Iterator[str]:
    """Run the page beside a daemon; yield its address."""
    program = str(Path(sys.executable).with_name("litegripd-web"))
    command = [program, "can0", "--port", "0", "--operate"]
    with subprocess.Popen(
        [*command, "--socket", daemon.socket_path], stdout=subprocess.PIPE, text=True
    ) as page:
        try:
            yield "" if page.stdout is None else page.stdout.readline().strip()
        finally:
            page.terminate()


def work(daemon: SimulatedDaemon, gripper: LiteGrip) -> None:
    """Do something that is worth a picture: a way there and back, and a grasp."""
    gripper.enable()
    gripper.goto(80.0, duration=0.8)
    gripper.goto(45.0, duration=0.8)
    gripper.open(80.0)
    daemon.put_object(OBJECT_MM)
    gripper.grasp(12.0, until="verdict")


@contextmanager
def chromium() -> Iterator[Browser]:
    """Run the system's browser."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        sys.exit("Chromium is missing: apt install chromium fonts-dejavu-core")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


def draw_page(daemon: SimulatedDaemon) -> None:
    """Take the page while something is held, light and dark, and behind a stop."""
    with shown(daemon) as address, chromium() as browser:
        tab = browser.new_page(viewport={"width": 1240, "height": 860})
        tab.goto(address)
        tab.get_by_role("button", name="Take control").click()
        tab.get_by_text("You have control").wait_for()
        on_the_page(tab)
        tab.evaluate("scrollTo(0, 0)")
        tab.screenshot(path=IMAGES / "page.png")
        tab.emulate_media(color_scheme="dark")
        tab.keyboard.press("Escape")
        clear = tab.get_by_role("button", name="Clear the stop")
        clear.wait_for()
        tab.wait_for_timeout(500)
        tab.screenshot(
            path=IMAGES / "page-stopped.png", clip={"x": 0, "y": 0, "width": 1240, "height": 560}
        )
        clear.click()
        clear.wait_for(state="hidden")


def on_the_page(tab: Page) -> None:
    """Do the same as `work`, by the page's buttons."""
    said = tab.locator("[data-is=outcome]")
    slider = tab.locator("[data-is=slider]")
    steps: tuple[tuple[Callable[[], None], str], ...] = (
        (lambda: tab.get_by_role("button", name="Enable").click(), "enable: done"),
        (lambda: slider.fill("75"), "move: reached"),
        (lambda: slider.fill("60"), "move: reached"),
        (lambda: tab.get_by_role("button", name="Open", exact=True).click(), "open: reached"),
        (lambda: tab.get_by_role("button", name="Put in").click(), ""),
        (lambda: tab.get_by_role("button", name="Grasp", exact=True).click(), "object held"),
    )
    for act, outcome in steps:
        act()
        said.filter(has_text=outcome).wait_for()
        tab.wait_for_timeout(1200)


def draw_film(daemon: SimulatedDaemon) -> None:
    """Film the page while the jaws open, grasp an object with a force, and are stopped."""
    frames: FilmFrames = []
    with shown(daemon) as address, chromium() as browser:
        tab = browser.new_page(viewport={"width": FILM["width"], "height": FILM["height"]})
        tab.goto(address)
        tab.get_by_role("button", name="Take control").click()
        tab.get_by_text("You have control").wait_for()
        tab.keyboard.press("e")
        tab.get_by_text("enable: done", exact=True).wait_for()
        tab.get_by_role("spinbutton", name="Force").fill("12")
        tab.evaluate("document.activeElement.blur(); scrollTo(0, 0)")
        film(tab, frames, 0.6)
        tab.keyboard.press("o")
        film(tab, frames, 1.6)
        daemon.put_object(OBJECT_MM)
        film(tab, frames, 1.2)
        tab.keyboard.press("g")
        film(tab, frames, 3.0)
        tab.keyboard.press("Escape")
        film(tab, frames, 2.5)
    save_film(frames, IMAGES / "page.gif")


def film(tab: Page, frames: FilmFrames, lasts_s: float) -> None:
    """Add pictures of the page for so long, each with when it was taken."""
    ends_s = time.monotonic() + lasts_s
    while (at_s := time.monotonic()) < ends_s:
        shot = tab.screenshot(clip=FILM)  # type: ignore[arg-type]
        frames.append((Image.open(io.BytesIO(shot)).convert("RGB"), at_s))
        tab.wait_for_timeout(max(0.0, 1000 * (at_s - time.monotonic() + 1 / FRAMES_A_SECOND)))


def save_film(frames: FilmFrames, path: Path) -> None:
    """Save a film that runs as fast as it was taken, in the colors that the page has."""
    pictures, times_s = [shot for shot, _at_s in frames], [at_s for _shot, at_s in frames]
    some = pictures[:: max(1, len(pictures) // 4)]
    width, height = some[0].size
    sheet = Image.new("RGB", (width, height * len(some)))
    for row, shot in enumerate(some):
        sheet.paste(shot, (0, height * row))
    palette = sheet.quantize(COLORS, dither=Image.Dither.NONE)
    drawn = [shot.quantize(palette=palette, dither=Image.Dither.NONE) for shot in pictures]
    ends_s = [*times_s[1:], times_s[-1] + 2.0]  # the last one stands before it begins again
    lasts_ms = [round(1000 * (end_s - at_s)) for at_s, end_s in zip(times_s, ends_s, strict=True)]
    drawn[0].save(
        path, save_all=True, append_images=drawn[1:], duration=lasts_ms, loop=0, optimize=False
    )


def draw_watch(daemon: SimulatedDaemon) -> None:
    """Record the live view while another program works."""

    def connect() -> Connection:
        return Connection(daemon.socket_path)

    console = Console(record=True, width=96, file=io.StringIO(), force_terminal=True)
    with daemon.gripper() as gripper:
        worker = threading.Thread(target=work, args=(daemon, gripper))
        for count, scene in enumerate(scenes(connect, connect(), 10.0)):
            if count == 0:
                worker.start()
            if count == WATCHED_STATES:
                console.print(picture(scene, "can0", str))
                break
        worker.join()
    console.save_svg(str(IMAGES / "watch.svg"), title="litegripctl watch")


def draw_post_mortem(daemon: SimulatedDaemon) -> None:
    """Plot what was before a fault and behind it."""
    with daemon.gripper() as gripper:
        work(daemon, gripper)
        sleep(2.0)
        daemon.fault("overload")
        sleep(1.0)
        try:
            gripper.open()
        except LiteGripError as error:
            sys.stdout.write(f"as it shall be: {error.message}\n")
        gripper.clear_fault()
        sleep(1.0)
        path = gripper.dump("the motor was overloaded")
    litegripctl(["plot", path, "--last", "15", "-o", str(IMAGES / "post-mortem.png")])


def draw_scene(daemon: SimulatedDaemon) -> None:
    """Let the scene's camera see what is held."""
    with daemon.gripper() as gripper:
        gripper.enable()
        gripper.grasp(10.0, until="verdict")
        program = Path(__file__).parents[1] / "examples" / "mujoco_view.py"
        command = [sys.executable, str(program), "--socket", daemon.socket_path]
        command += ["--picture", str(IMAGES / "mujoco.png")]
        subprocess.run(command, env={**os.environ, "MUJOCO_GL": "egl"}, check=True)


def main() -> None:
    """Make all of them."""
    IMAGES.mkdir(exist_ok=True)
    with simulated() as daemon:
        draw_page(daemon)
    with simulated() as daemon:
        draw_film(daemon)
    with simulated() as daemon:
        draw_watch(daemon)
    with simulated() as daemon:
        draw_post_mortem(daemon)
    with simulated(mechanics="mujoco") as daemon:
        draw_scene(daemon)


if __name__ == "__main__":
    main()
