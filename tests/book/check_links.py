"""Follows every link and anchor of the built book.

A link within the book must lead to a page, and its anchor to an element of it. One that leaves the book for the sources
(`../crates/…`) must lead to a file beside docs/. What lies on other machines is not asked for.
"""
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The links of a page, and what they can lead to."""

    def __init__(self, path):
        super().__init__()
        self.links, self.ids = [], set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name == "id":
                self.ids.add(value)
            elif name in ("href", "src") and value is not None:
                self.links.append(value)


def main():
    book, docs = (Path(argument).resolve() for argument in sys.argv[1:3])
    # The page for printing repeats all others, and that for lost readers knows no place of its own.
    names = [path for path in book.rglob("*.html") if path.name not in ("print.html", "404.html", "toc.html")]
    pages = {path: Page(path) for path in names}
    broken, followed = [], 0
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            followed += 1
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.is_relative_to(book):
                target = (docs / path.parent.relative_to(book) / unquote(parts.path)).resolve()
            if not target.exists():
                broken.append(f"{path.relative_to(book)}: {link} leads nowhere")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].ids:
                broken.append(f"{path.relative_to(book)}: {link} has no such anchor")
    print(f"{followed} links and anchors in {len(pages)} pages of the book")
    if broken or len(pages) < 5 or followed < 100:
        sys.exit("\n".join(broken) or "that cannot be all")


main()
