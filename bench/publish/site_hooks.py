"""What the site makes of the Markdown of the guides: lists and tables as public forges read them, formulas as MathML,
and players in place of links to sounds. MkDocs calls the functions whose names begin with `on_`."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

FENCE = re.compile(r"^(`{3,})[^\n]*\n.*?^\1`*\s*?$", re.MULTILINE | re.DOTALL)
NESTED_ITEM = re.compile(r"^ {2,3}(?=(?:[-*]|\d+\.) )", re.MULTILINE)
PARAGRAPH_BEFORE_LIST = re.compile(r"^((?![-*] |1\. |\s|\|).+\n)(?=(?:[-*]|1\.) )", re.MULTILINE)
LINE_BEFORE_TABLE = re.compile(r"^((?!\|).+\n)(?=\|.*\n\|[ :|-]+\n)", re.MULTILINE)
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
SOUND = re.compile(r'<a href="([^"]+\.(?:ogg|wav|flac|mp3))">(.*?)</a>', re.DOTALL)
PARAGRAPH = re.compile(r"<p>(?:(?!</p>).)*</p>", re.DOTALL)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The text with the indents and empty lines that Python's Markdown wants and others do not."""
    parts, end = [], 0
    for fence in FENCE.finditer(markdown):
        parts += [separate_blocks(markdown[end : fence.start()]), fence[0]]
        end = fence.end()
    return "".join([*parts, separate_blocks(markdown[end:])])


def separate_blocks(text: str) -> str:
    """Text without fenced code, with an empty line before each list and table, and items in items indented by four."""
    text = NESTED_ITEM.sub("    ", text)
    return LINE_BEFORE_TABLE.sub(r"\1\n", PARAGRAPH_BEFORE_LIST.sub(r"\1\n", text))


def on_page_content(html: str, **_: Any) -> str:
    """The page with its formulas as MathML and its sounds as players."""
    return PARAGRAPH.sub(add_players, FORMULA.sub(formula, html))


def formula(match: re.Match[str]) -> str:
    """A formula in LaTeX as MathML. Raises ValueError if it has a command or an environment that is not known."""
    latex = html.unescape(match[2]).strip()
    display = "block" if match[1] == "div" else "inline"
    mathml = convert(latex.replace("{aligned}", "{align*}"), display=display)  # which is the one that is known
    if "\\" in mathml or "<mi>&</mi>" in mathml:
        raise ValueError(f"no MathML for the formula {latex}")
    return f'<div class="formula">{mathml}</div>' if display == "block" else mathml


def add_players(paragraph: re.Match[str]) -> str:
    """A paragraph with a player in place of each link that is only the name of a sound, and players of others below."""
    below = []

    def replace(link: re.Match[str]) -> str:
        address, words = link.groups()
        element = f'<audio controls preload="none" src="{address}" title="{words}"></audio>'
        if words == address.rpartition("/")[2]:
            return element
        below.append(element)
        return link[0]

    text = SOUND.sub(replace, paragraph[0])
    return f"{text}\n<p>{' '.join(below)}</p>" if below else text
