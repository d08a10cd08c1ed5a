"""What the browser does while a step is drawn anew, in a real browser and without a server."""

from collections.abc import Iterator
from typing import Any

import pytest

from pipelines.web import SCRIPT
from tests.pipelines.calibrate.wizard_page import chromium

DRAWN = '<div id="step"><input data-test="tape" data-told="" value=""></div>'


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    page = browser.new_page()
    page.set_content(SCRIPT + DRAWN)
    page.evaluate(
        """() => {
            window.heard = [];
            for (const name of ["input", "keydown"])
              document.addEventListener(name, event => window.heard.push(
                name === "input" ? event.target.value : event.key));
        }"""
    )
    yield page
    page.close()


def _redrawn(page: Any) -> None:
    """The step is drawn anew from what was known before the typing, and released."""
    page.evaluate(
        "drawn => { document.querySelector('#step').outerHTML = drawn; window.wizard.release(); }",
        DRAWN,
    )


def test_what_is_typed_while_the_step_is_redrawn_is_typed_again(page: Any) -> None:
    page.focus("[data-test=tape]")
    assert page.evaluate("window.wizard.hold()")
    page.keyboard.type("0.451 m")
    _redrawn(page)
    assert page.input_value("[data-test=tape]") == "0.451 m"
    # and is not sent before its time
    assert page.evaluate("window.heard.filter(one => one === 'Enter').length") == 0


def test_what_is_sent_while_the_step_is_redrawn_is_sent_again(page: Any) -> None:
    page.focus("[data-test=tape]")
    assert page.evaluate("window.wizard.hold()")
    page.fill("[data-test=tape]", "0.451 m")
    page.press("[data-test=tape]", "Enter")
    page.evaluate("window.heard = []")
    _redrawn(page)
    assert page.evaluate("window.heard") == ["0.451 m", "Enter"]


def test_text_that_was_not_told_yet_holds_the_redrawing_off(page: Any) -> None:
    page.focus("[data-test=tape]")
    page.keyboard.type("0.4")
    assert not page.evaluate("window.wizard.hold()")
