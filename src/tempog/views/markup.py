"""HTML that is put together of parts, so that no text can become markup."""

from __future__ import annotations

import html


class Html(str):
    """Text that is markup already."""

    __slots__ = ()


def tag(name: str, /, *children: str, **attributes: str | int | None) -> Html:
    """An element. Children and attributes that are no `Html` are escaped; an attribute of None or False is left out.

    A name ends in ``_`` where Python has taken it, and has ``_`` for ``-``.

    >>> tag("p", "Tom & ", tag("b", "<Jerry>"), class_="cat", data_row=2)
    '<p class="cat" data-row="2">Tom &amp; <b>&lt;Jerry&gt;</b></p>'
    """
    words = [name]
    for key, value in attributes.items():
        if value is not None and value is not False:
            shown = "" if value is True else f'="{html.escape(str(value))}"'
            words.append(key.rstrip("_").replace("_", "-") + shown)
    opened = Html(f"<{' '.join(words)}>")
    return opened if name in VOID else Html(f"{opened}{joined(*children)}</{name}>")


VOID = ("br", "img", "meta")  # elements that hold nothing


def joined(*parts: str) -> Html:
    """Parts after each other, text among them escaped.

    >>> joined("1 < 2", tag("br"))
    '1 &lt; 2<br>'
    """
    return Html("".join(part if isinstance(part, Html) else html.escape(part) for part in parts))
