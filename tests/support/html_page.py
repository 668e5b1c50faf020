"""What tests of written HTML look at: its tags in order, its words, its styles, its scripts."""

import base64
import hashlib
from html.parser import HTMLParser

VOID = {"br", "hr", "img", "input", "link", "meta"}  # HTML never closes these; SVG closes every element


class Page(HTMLParser):
    """Collects tags, words, styles and scripts, and fails on tags that are not closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.styles: list[str] = []
        self.scripts: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open, f"tags left open: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        if "script" in self.open:
            self.scripts[-1] += data
        else:
            (self.styles if "style" in self.open else self.words).append(data)

    @property
    def text(self) -> str:
        """The words, blanks folded."""
        return " ".join(" ".join(self.words).split())

    def all(self, tag: str) -> list[dict[str, str | None]]:
        """Attributes of every tag of a name."""
        return [attributes for name, attributes in self.tags if name == tag]

    def asks_for(self) -> list[str]:
        """Everything that a browser would fetch or run, or follow on a click: empty for a page that stands alone.

        Pictures within the page (`data:image/png;base64,`) and places on it (`#`) are part of it; so are scripts that
        its content security policy knows by their hash, and JSON.
        """
        found = [f"<{tag}>" for tag, _ in self.tags if tag in ("link", "iframe", "object", "embed")]
        found += [f"<script>{text[:60]}" for text in self.unknown_scripts()]
        for tag, attributes in self.tags:
            found += [f"<{tag} {name}>" for name in attributes if name.startswith("on")]
            for name in ("src", "srcset", "href", "xlink:href", "poster", "action"):
                value = attributes.get(name)
                if value is not None and not value.startswith(("data:image/png;base64,", "#")):
                    found.append(f"<{tag} {name}={value[:60]}>")
            found += [f"<{tag} style>" for value in (attributes.get("style"),) if value and "url(" in value]
        return found + [word for word in ("url(", "@import") if word in "".join(self.styles)]

    def policy(self) -> str:
        """The page's content security policy, "" without one."""
        stated = [one for one in self.all("meta") if one.get("http-equiv") == "Content-Security-Policy"]
        return (stated[0]["content"] or "") if stated else ""

    def unknown_scripts(self) -> list[str]:
        """Scripts that would run although the policy does not name them."""
        found = []
        for attributes, text in zip(self.all("script"), self.scripts, strict=True):
            digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
            if attributes.get("type") != "application/json" and f"'sha256-{digest}'" not in self.policy():
                found.append(text)
        return found
