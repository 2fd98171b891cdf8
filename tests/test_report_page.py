"""The page of a report, opened in a browser as a person would."""

import re
from pathlib import Path

import pytest

from fake_runs import write_run

pytest.importorskip("matplotlib", reason="needs the extra report")
pytest.importorskip("jinja2", reason="needs the extra report")
playwright = pytest.importorskip("playwright.sync_api", reason="needs the package playwright")

CHROMIUM = Path("/usr/bin/chromium")
pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason=f"needs a browser: no {CHROMIUM}")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from entrack.report import write_report

    folder = tmp_path_factory.mktemp("report")
    trackers = {"default": 1.0, "opencv:csrt": 0.9, "a tracker with a rather long name": 0.7}
    run = write_run(folder / "run", trackers, sequences=12)
    write_run(run, trackers, dataset="vot2018", protocol="vot2018")
    return write_report([run], folder / "out")


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def page(browser, report):
    """The report, at first sight; it must not complain, nor ask anybody for anything."""
    page = browser.new_page()
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(report.as_uri())
    yield page
    assert not complaints
    assert [url for url in requests if not url.startswith("data:")] == [report.as_uri()]
    page.close()


def test_every_plot_is_drawn(page, report):
    files = {path.stem for path in (report.parent / "plots").glob("*.svg")}
    assert len(files) == 8
    shown = page.eval_on_selector_all(
        "figure.plot", "all => all.map(f => [f.id, f.querySelector('svg').getBoundingClientRect()])"
    )
    assert {name for name, _ in shown} == files
    assert all(box["width"] > 250 and box["height"] > 200 for _, box in shown)
    labels = page.eval_on_selector_all("figure.plot svg", "all => all.map(s => s.ariaLabel)")
    assert "Success on otb (protocol otb)" in labels
    ids = page.eval_on_selector_all("[id]", "all => all.map(e => e.id)")
    assert len(ids) == len(set(ids))


def test_numbers_on_axes_are_written_as_people_write_them(page):
    words = page.eval_on_selector_all(
        "figure.plot", "all => all.map(f => [f.id, f.querySelector('svg').textContent])"
    )
    assert not [name for name, text in words if "$" in text or "mathdefault" in text]


@pytest.mark.parametrize(
    ("speeds", "expected"), [([22, 58], ["20", "50"]), ([16, 994], ["20", "100", "500"])]
)
def test_a_few_speeds_stand_at_the_axis(speeds, expected):
    import matplotlib

    from entrack.report.plane import Point, plane
    from entrack.report.plots import RC

    points = [Point(f"tracker {x}", x, 0.5) for x in speeds]
    with matplotlib.rc_context(RC):
        figure = plane(points, "Speed", ("frames a second", "AUC"), log_x=True)
        axis = figure.axes[0].xaxis
        low, high = axis.get_view_interval()
        ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
        shown = [t.label1.get_text() for t in ticks if low <= t.get_loc() <= high]
    assert set(expected) <= set(shown) and len([s for s in shown if s]) <= 8
    assert not [s for s in shown if s and not s.isdecimal()]


def test_every_link_leads_somewhere(page):
    links = page.eval_on_selector_all(
        "a", "all => all.map(a => [a.getAttribute('href'), a.download])"
    )
    inside = [href for href, _ in links if href.startswith("#")]
    assert "#otb-otb" in inside and "#vot2018-vot2018" in inside and "#quoted" in inside
    assert all(page.query_selector(f"[id='{href[1:]}']") for href in inside)
    files = [(href, name) for href, name in links if not href.startswith("#")]
    assert files and all(re.fullmatch(r"[\w.+-]+\.(csv|md|tex)", name) for _, name in files)
    assert all(href.startswith("data:text/plain") and len(href) > 100 for href, _ in files)


def test_a_click_on_a_heading_sorts(page):
    table = page.locator("#otb-otb-sequences-auc")

    def first() -> str:
        return table.locator("tbody th").first.inner_text()

    assert first() == "video_0", "the worst first"
    heading = table.locator("thead button", has_text="default")
    heading.click()
    assert first() == "video_11", "numbers from high to low"
    heading.click()
    assert first() == "video_0"
    table.locator("thead button", has_text="Sequence").click()
    order = table.locator("tbody th").all_inner_texts()
    assert order == [f"video_{i}" for i in range(12)], "2 before 10"


def test_a_phone_scrolls_tables_not_the_page(page):
    page.set_viewport_size({"width": 360, "height": 740})
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    wide = page.locator("#otb-otb-overall .scroll")
    assert wide.evaluate("box => box.scrollWidth > box.clientWidth")


def test_paper_holds_every_table_and_picture(page):
    page.set_viewport_size({"width": 718, "height": 1000})  # A4 with margins of a centimetre
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate("document.documentElement.scrollWidth") == 718
    assert page.evaluate(
        "[...document.querySelectorAll('.scroll')].every(b => b.scrollHeight <= b.clientHeight + 1)"
    ), "nothing is hidden behind a scroll bar"
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert paper == "rgb(255, 255, 255)", "dark mode is for screens"


def test_dark_mode_turns_paper_and_ink(page):
    colours = []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        colours.append(
            page.evaluate(
                """() => [document.body, document.querySelector(".plot text")].map(
                    element => getComputedStyle(element)).flatMap(
                    style => [style.backgroundColor, style.color, style.fill])"""
            )
        )
    light, dark = colours
    assert light[0] == "rgb(255, 255, 255)" and light[0] != dark[0]
    assert light[1] != dark[1] and light[5] != dark[5], "words on the page and in plots"
