"""Make the pictures of the README: a report of a run in a browser.

    python tools/screenshots.py RUN

RUN is a finished run of three-learners. Its report is made anew, opened in Chromium, and photographed twice: the
beginning, and the games to watch. The pictures go to docs/figures.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from analysis.report import make_report
from coevo.run import open_run

FIGURES = Path(__file__).resolve().parent.parent / "docs" / "figures"
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
WIDTH, HEIGHT = 1100, 1290


def main(words: list[str]) -> int:
    """Make both pictures; the exit code is 2 if there is no run or no browser."""
    browser = next(filter(None, map(shutil.which, NAMES)), None)
    if len(words) != 1 or browser is None:
        print(__doc__ if browser else "There is no Chromium: run 'make browser'.", file=sys.stderr)
        return 2
    page, _ = make_report([open_run(words[0])], workers=2, backend="threads", tell=print)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        path = Path(folder) / "report.html"
        path.write_text(page, encoding="utf-8")
        chromium = driver.chromium.launch(executable_path=browser, args=["--no-sandbox", "--disable-gpu"])
        shown = chromium.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        shown.goto(path.as_uri())
        shown.add_style_tag(content="nav { position: static !important; }")  # or it hides what is photographed
        shown.locator(".chart svg").first.wait_for()
        shown.screenshot(path=FIGURES / "report.png")
        frame = shown.frame_locator("iframe")
        shown.locator("#games").scroll_into_view_if_needed()
        shown.wait_for_timeout(1000)
        for _ in range(5):  # a second each
            frame.locator("#play").press("Shift+ArrowRight")
        shown.wait_for_timeout(500)
        shown.locator("iframe").screenshot(path=FIGURES / "game.png")
        chromium.close()
    print(f"Written: {FIGURES / 'report.png'}, {FIGURES / 'game.png'}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
