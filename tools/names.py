"""Names in the words of a page: links, files of the checkout, and what Python can import."""

import pkgutil
import re
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from pages import LieError, Page

__all__ = ["check_names"]

_LINK = re.compile(r"\]\(([^)\s:#]+)(?:#[^)]*)?\)")
_FILE = re.compile(r"`((?:coevo|behaviors|analysis|docs|runs|tests|tools)/[\w./-]+\.(?:py|md|toml|html))(?:: (\w+))?`")
_THING = re.compile(r"`((?:coevo|behaviors|analysis)(?:\.\w+)+)(?:: (\w+))?[`(]")
_PLACEHOLDER = re.compile(r"\b[A-Z]{2,}\b")


def check_names(page: Page, root: Path) -> int:
    """See that what a page names is there; return how many names there are.

    Links are relative to the page, files to the checkout. ``module: name`` and ``file.py: name`` name what is in them.

    Raises:
        LieError: something is not there.
    """
    count = 0
    declared = (root / "pyproject.toml").read_text("utf-8")
    for first, text in page.paragraphs:
        for found in _LINK.finditer(text):
            if not (root / page.name).parent.joinpath(unquote(found[1])).exists():
                raise _lie(page, first, text, found, "there is no such page or file")
            count += 1
        for found in _FILE.finditer(text):
            if _PLACEHOLDER.search(found[1]):
                continue
            if not (root / found[1]).is_file():
                raise _lie(page, first, text, found, "there is no such file")
            if found[2] is not None:
                module = ".".join(PurePosixPath(found[1]).with_suffix("").parts).removesuffix(".__init__")
                _resolve(page, first, text, found, module)
            count += 1
        for found in _THING.finditer(text):
            if f'"{found[1]}"' not in declared:  # a group of entry points is no module
                _resolve(page, first, text, found, found[1])
            count += 1
    return count


def _resolve(page: Page, first: int, text: str, found: re.Match[str], name: str) -> None:
    try:
        pkgutil.resolve_name(".".join([name, *([found[2]] if found[2] else [])]))
    except (ImportError, AttributeError) as error:
        raise _lie(page, first, text, found, str(error)) from None


def _lie(page: Page, first: int, text: str, found: re.Match[str], said: str) -> LieError:
    return LieError(f"{page.name}:{first + text[: found.start()].count(chr(10))}: '{found[1]}': {said}")
