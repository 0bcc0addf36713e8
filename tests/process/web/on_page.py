"""What is seen and done on the page, by the words that stand on it."""

import re
from typing import Any

from playwright.sync_api import BrowserContext, Locator, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import DEADLINE_S, Client
from tests.process.web.page_process import Page

expect.set_options(timeout=DEADLINE_S * 1000)

OBJECT_MM = 40.0

SEEN = """
(node, part) => {
  const text = node.lastChild;
  const words = document.createRange();
  words.setStart(text, text.data.indexOf(part));
  words.setEnd(text, text.data.indexOf(part) + part.length);
  const last = [...words.getClientRects()].at(-1);
  const room = node.closest(".why") ?? node;
  return last.top + last.height / 2 < room.getBoundingClientRect().bottom;
}
"""
"""Whether a part of what a node says is in sight, and not cut off."""


def called_well(more: str = "") -> re.Pattern[str]:
    """Match what the page calls a gripper with which nothing is wrong, on a busy machine, too."""
    busy = "the daemon itself stood still for|ticks start late"
    return re.compile(f"^(Healthy{more}|Degraded{more}: ({busy}) .*)$")


def opened(window: BrowserContext, running: Page) -> Tab:
    """Show the page of a gripper, as soon as that is known."""
    tab = window.new_page()
    tab.goto(running.told)
    expect(part(tab, "mode")).not_to_have_text(re.compile("connecting|no (daemon|connection)"))
    return tab


def part(tab: Tab, name: str) -> Locator:
    return tab.locator(f"[data-is={name}]")


def button(tab: Tab, name: str) -> Locator:
    return tab.get_by_role("button", name=name, exact=True)


def fact(tab: Tab, name: str) -> Locator:
    """Find the figure behind a name."""
    return tab.locator(f"dt:text-is('{name}') + dd")


def take_control(tab: Tab) -> None:
    button(tab, "Take control").click()
    expect(button(tab, "Disable")).to_be_enabled()


def enable(tab: Tab, client: Client) -> None:
    take_control(tab)
    button(tab, "Enable").click()
    client.until(lambda state: bool(state["enabled"]))
    expect(button(tab, "Open")).to_be_enabled()


def correct_the_scale(tab: Tab) -> None:
    """Correct it by the dialog that measures, which asks before it saves."""
    button(tab, "Correct the scale only").click()
    button(tab, "Correct and save").click()


def grasp(client: Client, force_n: float = 10.0) -> None:
    """Grasp as another program would."""
    client.despite_silence("motor.enable")
    client.despite_silence("motion.open")
    client.result("sim.object", width_mm=OBJECT_MM)
    assert client.despite_silence("motion.grasp", force_n=force_n, until="verdict")["ok"]


def drag(tab: Tab, node: Locator, dx: float, dy: float, until: Any = lambda: True) -> None:
    """Drag a node's middle by so many pixels; let it go when a condition holds."""
    node.scroll_into_view_if_needed()
    box = node.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + dx, y + dy, steps=5)
    while not until():
        tab.wait_for_timeout(20)
    tab.mouse.up()


def teach(tab: Tab, client: Client, name: str) -> None:
    """Teach a motion by a hand at the jaws, from the page."""
    enable(tab, client)
    part(tab, "name").fill(name)
    button(tab, "Teach").click()
    client.until(lambda state: bool(state["job"] and state["job"]["kind"] == "record"))
    client.result("sim.push", torque_nm=0.6)
    client.until(lambda state: bool(state["opening_mm"] < 40))
    client.result("sim.push", torque_nm=0)
    button(tab, "End and keep").click()
    expect(part(tab, "outcome")).to_contain_text(f"kept as {name}")


def kinds_since(client: Client, before: list[dict[str, Any]]) -> list[str]:
    """Return the kinds of the jobs that are newer than those; the daemon keeps the last ones."""
    newest = max((job["job"] for job in before), default=0)
    return [job["kind"] for job in client.result("job.list")["jobs"] if job["job"] > newest]


def discard(tab: Tab) -> None:
    """Discard a recording, which is asked about first."""
    button(tab, "Discard").click()
    button(tab, "Discard it").click()


PLACES = """
() => [...document.querySelectorAll(
  ".jaws, [data-is=slider], [data-do], #stop, .head, [data-is=facts], .plots"
)].filter((node) => node.checkVisibility() && node.dataset.do !== "clear")
  .map((node) => {
    const {x, y, width, height} = node.getBoundingClientRect();
    const name = node.dataset.do ?? node.dataset.is ?? node.id ?? node.className;
    return [name, ...[x, y, width, height].map(Math.round)].join(" ");
  })
"""
"""Where everything is that somebody looks at or aims at."""


def wait_until_it_fits(tab: Tab) -> None:
    """Wait until nothing is wider than the window: the plots follow its width a frame later.

    Not by `wait_for_function`, whose second look is an `eval`, which the page's policy forbids.
    """
    tab.evaluate(
        """async () => {
          while (document.documentElement.scrollWidth > innerWidth)
            await new Promise(requestAnimationFrame);
        }"""
    )


def places(tab: Tab) -> list[str]:
    """Return where everything is."""
    found: list[str] = tab.evaluate(PLACES)
    return found


KEEP_WHAT_IS_SENT = """
() => {
  const send = WebSocket.prototype.send;
  window.sent = [];
  WebSocket.prototype.send = function (text) {
    window.sent.push(JSON.parse(text));
    send.call(this, text);
  };
}
"""


def sent(tab: Tab, method: str) -> dict[str, Any]:
    """Return the parameters with which the page has called a method."""
    lines: list[dict[str, Any]] = tab.evaluate("window.sent")
    params: dict[str, Any] = next(line["params"] for line in lines if line["method"] == method)
    return params
