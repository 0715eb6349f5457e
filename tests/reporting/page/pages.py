"""Pages read as a browser reads them: elements, their attributes, and the text within."""

import json
from collections import Counter
from html.parser import HTMLParser
from typing import Any

VOID = {"meta", "link", "input", "br", "hr", "img", "line", "circle"}


class Read(HTMLParser):
    """Every element with its attributes' names, and every text with what it stands in."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: Counter[tuple[str, tuple[str, ...]]] = Counter()
        self.attributes: list[tuple[str, str, str]] = []
        self.texts: list[tuple[tuple[str, ...], str]] = []
        self._open: list[str] = []
        self.feed(page)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Counts it."""
        self.elements[tag, tuple(name for name, _ in attrs)] += 1
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Of the drawings."""
        self.elements[tag, tuple(name for name, _ in attrs)] += 1

    def handle_endtag(self, tag: str) -> None:
        """Everything that was opened is closed, in order."""
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Keeps it with its place."""
        self.texts.append((tuple(self._open), data))

    @property
    def text(self) -> str:
        """What a reader sees."""
        hidden = {"script", "style"}
        return " ".join(text for path, text in self.texts if not hidden & set(path))


def data_of(page: str) -> dict[str, Any]:
    """The data of the page's script."""
    start = page.index('id="gk-data">') + len('id="gk-data">')
    found: dict[str, Any] = json.loads(page[start : page.index("</script>", start)])
    return found
