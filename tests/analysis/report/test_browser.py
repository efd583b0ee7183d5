"""The page in a browser: it opens without a complaint, asks for nothing, and its controls work."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.slow


def scroll_through(page):
    """Bring every chart near, so that it is drawn."""
    for chart in page.locator(".chart").all():
        chart.scroll_into_view_if_needed()
        chart.locator("svg").first.wait_for()


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_a_report_opens_and_draws_all_charts(open_page, reported, width, scheme):
    opened = open_page(reported[0], width=width, scheme=scheme)
    scroll_through(opened.page)
    assert opened.page.locator(f'.chart[data-drawn="{scheme}"]').count() == opened.page.locator(".chart").count()
    assert opened.complaints == []
    assert opened.requests == []
    # Nothing but what scrolls by itself is wider than the window.
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= width


def test_charts_change_with_the_colour_scheme(open_page, reported):
    page = open_page(reported[0]).page
    chart = page.locator(".chart").first
    chart.locator("svg").wait_for()
    page.emulate_media(color_scheme="dark")
    page.locator('.chart[data-drawn="dark"]').first.wait_for()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != "rgb(246, 247, 248)"


def test_contents_and_tables_work_by_keyboard(open_page, reported):
    opened = open_page(reported[0])
    page = opened.page
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.locator("nav a", has_text="Progress").focus()
    page.keyboard.press("Enter")
    page.wait_for_function("location.hash === '#progress'")
    summary = page.locator("#curves summary").first
    summary.focus()
    page.keyboard.press("Enter")
    assert page.locator("#curves details").first.locator("table").is_visible()
    assert opened.complaints == []


def test_games_play_within_the_page(open_page, reported):
    opened = open_page(reported[0])
    opened.page.locator("iframe").scroll_into_view_if_needed()  # out of sight it stands still
    frame = opened.page.frame_locator("iframe")
    frame.locator("#play").click()
    opened.page.wait_for_timeout(600)
    frame.locator("#play").click()
    assert int(frame.locator("#scrub").input_value()) > 0
    # The frame has as much room as the player needs.
    inside = opened.page.frames[1].evaluate("document.documentElement.scrollHeight - window.innerHeight")
    assert inside <= 4
    assert opened.complaints == []
    assert opened.requests == []


def test_a_comparison_opens_and_draws_all_charts(open_page, compared):
    opened = open_page(compared[0], width=390)
    scroll_through(opened.page)
    assert opened.complaints == []
    assert opened.requests == []
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= 390
