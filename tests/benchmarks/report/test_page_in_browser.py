"""The page in a real browser: Debian's Chromium, driven by playwright."""

import shutil
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from made_up_pages import HOSTILE, moment, results
from PIL import Image

from roadscope.benchmarks.report import Run, save_page

CHROMIUM = shutil.which("chromium")
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no program chromium is installed"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield opened
        opened.close()


@pytest.fixture
def visit(browser, tmp_path) -> Iterator[Any]:
    """Open the page of some runs; afterwards nothing may have gone wrong or left the page."""
    wrong: list[str] = []
    contexts = []

    def show(*runs: Run, **settings: Any) -> Any:
        path = tmp_path / "report.html"
        save_page(runs, path)
        contexts.append(browser.new_context(**settings))
        page = contexts[-1].new_page()
        page.on("console", lambda message: wrong.append(f"console: {message.text}"))
        page.on("pageerror", lambda error: wrong.append(f"error: {error}"))
        page.on("dialog", lambda dialog: wrong.append(f"dialog: {dialog.message}"))
        page.on("request", lambda request: _note(wrong, request.url, path))
        page.goto(path.as_uri())
        return page

    yield show
    for context in contexts:
        context.close()
    assert wrong == []


def _note(wrong: list[str], url: str, path: Path) -> None:
    if url.partition("#")[0] != path.as_uri() and not url.startswith("data:"):
        wrong.append(f"request: {url}")


def entries(page: Any) -> list[str]:
    """Return the names in the table that can be seen, from above."""
    names: list[str] = page.locator(".ranks tbody tr:not([hidden]) .choose").all_inner_texts()
    return names


RUN = Run(results(), [moment("good"), moment("poor", kind="false alarms", event=3)])


def test_boards_are_sorted_and_filtered(visit) -> None:
    page = visit(RUN)
    assert entries(page) == ["good", "poor", "good on oracle"]
    heading = page.locator(".ranks thead button", has_text="HOTA")
    heading.click()
    assert entries(page) == ["good on oracle", "good", "poor"]
    heading.press("Enter")
    assert entries(page) == ["poor", "good", "good on oracle"]
    page.get_by_label("Show entries with").fill("GOOD")
    assert entries(page) == ["good", "good on oracle"]
    page.get_by_label("marks").uncheck()
    assert entries(page) == ["good"]
    assert "1 of 3" in page.locator(".count").inner_text()


def test_plots_follow_the_chosen_entry(visit) -> None:
    page = visit(RUN)
    assert page.locator(".times svg .dot").count() == 3
    page.locator(".choose", has_text="poor").first.click()
    assert page.locator(".entry").input_value() == "1"
    texts = " ".join(page.locator(".differences svg text").all_text_contents())
    assert "good on oracle" in texts
    assert "+0.30 better" in texts
    page.locator(".differences .difference").first.press("Enter")
    assert page.locator("tr.is-chosen .choose").inner_text() == "good"
    assert "-0.30 worse" in " ".join(page.locator(".differences svg text").all_text_contents())
    page.locator(".times .metric").select_option("mota")
    assert "MOTA" in page.locator(".times svg").get_attribute("aria-label")


def test_figures_are_broken_down(visit) -> None:
    page = visit(RUN)
    page.locator(".breakdown .by").select_option(label="scenario")
    headings = page.locator(".breakdown th[scope=col]").all_inner_texts()
    assert headings == ["entry", "motorway", "merge"]
    cells = page.locator(".breakdown tbody tr").first.locator("td")
    assert cells.first.inner_text().split()[0] == "0.83"


def test_what_stands_behind_a_figure_in_brackets_is_shown(visit) -> None:
    page = visit(Run(results(detectors=("pag", "network")), []))
    page.locator(".breakdown .by").select_option(label="detector")
    cells = page.locator(".breakdown tbody tr").first.locator("td").all_inner_texts()
    assert all(cell.startswith("0.83 (1)") for cell in cells), cells
    assert "In brackets" in page.locator(".breakdown .hint").inner_text()


def test_the_picture_is_moved_by_keys_and_by_dragging(visit) -> None:
    page = visit(RUN)
    scene = page.locator(".scene svg")

    def corner() -> list[float]:
        return [float(number) for number in scene.get_attribute("viewBox").split()[:2]]

    before = corner()
    page.locator(".scene").press("ArrowRight")
    right = corner()
    assert right[0] > before[0]
    assert right[1] == before[1]
    scene.hover()
    box = scene.bounding_box()
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + 50)
    page.mouse.up()
    assert corner()[1] < right[1]
    page.locator(".moments button").first.click()
    assert corner() == before


def test_a_legend_has_what_is_shown_and_no_more(visit) -> None:
    page = visit(Run(results(), [moment("good", answers=[])]))
    legend = page.locator(".legend").inner_text()
    assert "ego" in legend
    assert "object that is missed" in legend
    assert "identity switch" not in legend
    assert "false alarm" not in legend


def test_the_replay_moves_with_its_slider(visit) -> None:
    from playwright.sync_api import expect

    page = visit(RUN)
    page.locator(".choose", has_text="good").first.click()
    slider, scene = page.get_by_role("slider", name="time"), page.locator(".scene svg")
    assert slider.input_value() == "5"
    assert scene.locator("polygon.truth.x").count() == 1
    assert scene.locator("polygon.answer.s").count() == 1
    state = page.locator(".state").inner_text()
    before = scene.locator("polygon.ego").get_attribute("points")
    slider.press("ArrowRight")
    assert slider.input_value() == "6"
    assert page.locator(".state").inner_text() != state
    assert scene.locator("polygon.ego").get_attribute("points") != before
    assert scene.locator("polygon.answer.f").count() == 1
    for _ in range(6):
        slider.press("ArrowLeft")
    assert scene.locator("polygon.truth.x, polygon.answer.f").count() == 0
    wide = scene.get_attribute("viewBox").split()[2]
    page.get_by_label("zoom").press("ArrowRight")
    assert float(scene.get_attribute("viewBox").split()[2]) < float(wide)
    page.get_by_role("button", name="Play").click()
    expect(slider).to_have_value("10")
    assert "1 missed" in page.locator(".state").inner_text()


def test_moments_are_those_of_the_chosen_entry(visit) -> None:
    page = visit(RUN)
    page.locator(".choose", has_text="poor").first.click()
    assert page.locator(".moments button").count() == 1
    assert page.locator(".moments button").inner_text().startswith("false alarms")
    page.locator("select.entry").select_option(label="good on oracle")
    assert page.locator(".viewer").is_hidden()
    assert "it is a mark" in page.locator(".replay .none").inner_text()


def test_collisions_stand_together_with_detections_and_how_many_are_left_out(visit) -> None:
    own = {"text": "collides with car 8", "answers": [(-1, 5, "d", 46, 18, [300, 30, 0])]}
    kinds = ("collision", "near miss", "collision")
    shown = [moment("good", kind=kind, **own) for kind in kinds]
    page = visit(Run(results(), [*shown, moment("good", text=1_500_000 * "x")]))
    page.locator(".choose", has_text="good").first.click()
    buttons = page.locator(".moments button").all_inner_texts()
    assert [text.partition(",")[0] for text in buttons] == ["collision", "collision", "near miss"]
    assert page.locator(".left-out").inner_text().startswith("1 more moment")
    assert page.locator(".scene polygon.answer.d").count() == 1
    assert "detection before tracking or fusion" in page.locator(".legend").inner_text()
    page.locator(".choose", has_text="poor").first.click()
    assert page.locator(".left-out").inner_text() == ""


def test_a_moment_in_images_shows_them_with_their_boxes(visit) -> None:
    file = BytesIO()
    Image.new("RGB", (64, 48), (90, 120, 150)).save(file, "JPEG")
    place = [3200, -2400, 0]
    in_images = moment(
        "good",
        ego=[],
        lanes=[],
        size_px=(640, 480),
        focus=(3200, -2400, 1600, 1200),
        times_s=[0.0, 0.5],
        event=0,
        images=[file.getvalue(), b""],
        objects=[(-1, 0, "x", 400, 600, place, "pedestrian"), (-1, 1, "m", 400, 600, place, "van")],
        answers=[(-1, 0, "f", 200, 200, [5000, -1000, 0], "car 0.71")],
    )
    page = visit(Run(results(), [in_images]))
    page.locator(".choose", has_text="good").first.click()
    scene = page.locator(".scene svg")
    assert scene.locator("image").count() == 1
    picture, missed = scene.locator("image").bounding_box(), scene.locator("polygon.truth.x")
    box = missed.bounding_box()
    assert box["x"] + box["width"] / 2 == pytest.approx(picture["x"] + picture["width"] / 2, abs=2)
    assert box["height"] == pytest.approx(picture["height"] * 60 / 480, abs=6)
    texts = scene.locator("text").all_text_contents()
    assert {"pedestrian", "car 0.71"} <= set(texts)
    assert scene.locator("polygon.ego, .ring").count() == 0
    assert "ego" not in page.locator(".legend").inner_text().split()
    page.get_by_role("slider", name="time").press("ArrowRight")
    assert scene.locator("image").count() == 0
    assert "no image" in page.locator(".state").inner_text()
    assert scene.locator("polygon.truth.m").count() == 1


def test_a_moment_from_above_shows_the_image_beside_it(visit) -> None:
    file = BytesIO()
    Image.new("RGB", (64, 48), (90, 120, 150)).save(file, "JPEG")
    place, times_s = [1600, -2400, 0], [0.0, 0.5]
    seen_twice = moment(
        "good",
        ego=[0, 0, 0, 8, 0, 0],
        times_s=times_s,
        event=0,
        objects=[(4, 0, "xm", 46, 18, [300, 30, 0, 8, 0, 0], "car")],
        answers=[],
        size_px=(640, 480),
        images=[file.getvalue(), b""],
        image_objects=[(-1, 0, "x", 200, 150, place, "car"), (-1, 1, "m", 200, 150, place, "car")],
        image_answers=[(-1, 0, "d", 180, 140, place, "car 0.31")],
        image_focus=(1600, -2400, 800, 600),
    )
    page = visit(Run(results(), [seen_twice]))
    page.locator(".choose", has_text="good").first.click()
    above, beside = page.locator(".scene svg"), page.locator(".beside svg")
    assert above.locator("polygon.truth.x").count() == above.locator("polygon.ego").count() == 1
    assert beside.locator("polygon.ego, .ring, .lane").count() == 0
    image, missed = (beside.locator(each).bounding_box() for each in ("image", "polygon.truth.x"))
    middle = [box["x"] + box["width"] / 2 for box in (image, missed)]
    assert middle[0] - middle[1] == pytest.approx(image["width"] / 4, abs=2)
    assert beside.locator("polygon.answer.d").count() == 1
    assert "detection before tracking or fusion" in page.locator(".legend").inner_text()
    page.get_by_role("slider", name="time").press("ArrowRight")
    assert beside.locator("image").count() == 0
    assert beside.locator("polygon.truth.m").count() == 1
    assert above.locator("polygon.truth.m").count() == 1


def test_a_drive_shows_both_paths(visit) -> None:
    motion = [0, 0, 0, *[8, 0, 0] * 10]
    drive = moment(
        "good",
        kind="jump",
        ego=motion,
        estimate=[0, 0, 0, *[8, 1, 0] * 10],
        errors=[10 * k for k in range(11)],
        objects=[],
        answers=[],
        lanes=[],
    )
    page = visit(Run(results(), [drive]))
    page.locator(".choose", has_text="good").first.click()
    page.get_by_role("slider", name="time").fill("10")
    assert page.locator("polyline.estimate-line, polyline.ego-line").count() == 2
    assert "1.00 m off" in page.locator(".state").inner_text()


def test_everything_is_reached_by_keyboard(visit) -> None:
    page = visit(RUN)
    reached = set()
    for _ in range(80):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate(
                "(e => e.closest('svg') ? 'plot' : e.type === 'range' ? 'slider' : e.tagName)"
                "(document.activeElement)"
            )
        )
    assert {"BUTTON", "INPUT", "SELECT", "SUMMARY", "plot", "slider"} <= reached


OVERLAPS = """
[...document.querySelectorAll('.times svg g text')].map(t => t.getBoundingClientRect())
  .filter((a, k, all) => all.slice(k + 1).some(b =>
    Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 &&
    Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 4)).length
"""


def test_labels_of_many_entries_do_not_overlap_and_become_ranks(visit) -> None:
    page = visit(Run(results(more=20), []))
    assert page.locator(".times svg .dot").count() == 23
    labels = page.locator(".times svg g text").all_text_contents()
    assert len(labels) > 8
    assert any(label.startswith("#") for label in labels)
    assert page.evaluate(OVERLAPS) == 0
    assert "#: rank" in page.locator(".times svg").text_content()


def test_boards_are_shown_one_at_a_time(visit) -> None:
    page = visit(RUN, Run(results(suite="other"), []))
    sections = page.locator("section.board")
    assert [sections.nth(k).is_visible() for k in range(2)] == [True, False]
    page.locator("#boards a").nth(1).click()
    sections.nth(1).wait_for(state="visible")
    assert [sections.nth(k).is_visible() for k in range(2)] == [False, True]
    assert sections.nth(1).locator(".times svg .dot").count() == 3


@pytest.mark.parametrize("width", [320, 375, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_fits_and_is_readable(visit, width, scheme) -> None:
    page = visit(RUN, viewport={"width": width, "height": 800}, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    contrasts = page.evaluate(CONTRASTS)
    assert contrasts
    assert min(contrasts.values()) >= 4.5, contrasts
    sizes = page.evaluate(
        "[...document.querySelectorAll('svg text')].filter(t => t.getBoundingClientRect().height)"
        ".map(t => t.getBoundingClientRect().height)"
    )
    assert min(sizes) >= 10
    dark = page.evaluate("getComputedStyle(document.body).backgroundColor") != "rgb(255, 255, 255)"
    assert dark == (scheme == "dark")
    page.locator("#theme").click()
    after = page.evaluate("getComputedStyle(document.body).backgroundColor") != "rgb(255, 255, 255)"
    assert after != dark


CONTRASTS = """() => {
  const canvas = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
  const luminance = (name) => {
    canvas.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    canvas.fillRect(0, 0, 1, 1);
    const parts = [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3).map((part) => {
      const share = part / 255;
      return share <= 0.03928 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
  };
  const pairs = [["--ink", "--paper"], ["--soft", "--paper"], ["--ink", "--raised"],
    ["--soft", "--raised"], ["--false", "--paper"]];
  return Object.fromEntries(pairs.map(([a, b]) => {
    const [x, y] = [luminance(a), luminance(b)];
    return [`${a} on ${b}`, (Math.max(x, y) + 0.05) / (Math.min(x, y) + 0.05)];
  }));
}"""
"""Contrast of texts as WCAG 2 defines it; 4.5 is its level AA."""


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_is_shown_as_text(visit, name) -> None:
    page = visit(Run(results(entry=name, reason=name, log=name), [moment(name, text=name)]))
    assert name in entries(page)
    assert page.locator("img, iframe").count() == 0
    page.locator("select.entry").select_option(label=name)
    assert name in page.locator(".event").inner_text()
    page.locator(".failures summary").click()
    assert page.locator(".failures pre").inner_text() == name


def test_tables_are_there_without_scripts(visit) -> None:
    page = visit(RUN, java_script_enabled=False)
    assert entries(page) == ["good", "poor", "good on oracle"]
    assert page.locator("noscript").inner_text()
    assert page.locator(".times").is_hidden()
