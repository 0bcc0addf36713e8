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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import sleep

from playwright.sync_api import Page, sync_playwright
from rich.console import Console

from litegrip_client import LiteGrip, LiteGripError
from litegrip_client.ctl.live import picture, scenes
from litegrip_client.ctl.main import main as litegripctl
from litegrip_client.line.connection import Connection
from litegrip_client.testing import SimulatedDaemon, simulated

IMAGES = Path(__file__).parent / "images"
OBJECT_MM = 40.0
WATCHED_STATES = 160


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


def draw_page(daemon: SimulatedDaemon) -> None:
    """Take the page while something is held, light and dark, and behind a stop."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("Chromium is missing: apt install chromium fonts-dejavu-core")
    with shown(daemon) as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1240, "height": 860})
        tab.goto(address)
        tab.get_by_role("button", name="Take control").click()
        tab.get_by_text("You have control").wait_for()
        on_the_page(tab)
        tab.evaluate("scrollTo(0, 0)")
        tab.screenshot(path=IMAGES / "page.png")
        tab.emulate_media(color_scheme="dark")
        tab.keyboard.press("Escape")
        stopped = tab.locator("[data-is=stopped]")
        stopped.wait_for()
        tab.wait_for_timeout(500)
        tab.screenshot(
            path=IMAGES / "page-stopped.png", clip={"x": 0, "y": 0, "width": 1240, "height": 560}
        )
        tab.get_by_role("button", name="Clear the stop").click()
        stopped.wait_for(state="hidden")
        browser.close()


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
        draw_watch(daemon)
    with simulated() as daemon:
        draw_post_mortem(daemon)
    with simulated(mechanics="mujoco") as daemon:
        draw_scene(daemon)


if __name__ == "__main__":
    main()
