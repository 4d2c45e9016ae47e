"""The guides as a site: everything in it leads somewhere, is read as on a public forge, and comes from itself alone."""

import functools
import html
import json
import re
import shutil
import subprocess
import threading
from collections import Counter
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from conftest import ROOT
from markdown_it import MarkdownIt

from bench.publish import site, site_hooks

LOADED = {"src", "srcset", "poster", "data"}  # attributes whose files a browser loads by itself
CSS_ADDRESS = re.compile(r"url\(\s*['\"]?([^'\")]+)|@import\s+['\"]([^'\"]+)")
STRUCTURE = ("li", "table", "td", "pre", "blockquote")


class Page(HTMLParser):
    """What a page of the site links to, loads and holds."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.policy = ""
        self.count: Counter[str] = Counter()
        self.in_article = False
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {key: value or "" for key, value in attrs}
        self.anchors |= {found[key] for key in ("id", "name") if key in found}
        self.loaded += [found[key] for key in LOADED & found.keys() if tag != "meta"]
        if tag == "link":
            self.loaded.append(found["href"])
        elif "href" in found:
            self.links.append(found["href"])
        if found.get("http-equiv") == "Content-Security-Policy":
            self.policy = found["content"]
        self.loaded += [first or second for first, second in CSS_ADDRESS.findall(found.get("style", ""))]
        self.in_article |= tag == "article"
        self.count[tag] += self.in_article

    def handle_endtag(self, tag: str) -> None:
        self.in_article &= tag != "article"


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    assert site.main([str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def pages(built):
    return {path: Page(path) for path in built.rglob("*.html") if path.name != "404.html"}


@pytest.mark.hard
def test_the_gallery_links_pages_that_play(tmp_path, monkeypatch):
    """Those of the patches that can become one; each is among the files of the site."""

    def make_pages(folder):
        (folder / "marimba.html").write_text("<p>a page</p>")
        return ["marimba"]

    monkeypatch.setattr(site, "make_pages", make_pages)
    assert site.main([str(tmp_path / "site"), "--play"]) == 0
    links = Page(tmp_path / "site" / "docs" / "gallery_bars.html").links
    assert [link for link in links if link.startswith("../play/")] == ["../play/marimba.html"]
    assert (tmp_path / "site" / "play" / "marimba.html").read_text() == "<p>a page</p>"


def guides() -> list[Path]:
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def shown_at(built: Path, guide: Path) -> Path:
    """The page of a guide."""
    return built / ("index.html" if guide.parent == ROOT else f"docs/{guide.stem}.html")


@pytest.mark.hard
def test_every_guide_is_a_page_that_the_navigation_has(built, pages):
    front = {(built / link).resolve() for link in pages[built / "index.html"].links}
    assert {shown_at(built, guide).resolve() for guide in guides()} <= front | {(built / "index.html").resolve()}


@pytest.mark.hard
def test_links_anchors_pictures_and_sounds_lead_somewhere(pages):
    looked_at: Counter[str] = Counter()
    for path, page in pages.items():
        for address in page.links + page.loaded:
            parts = urlsplit(address)
            if parts.scheme in ("https", "data") or address.endswith(("/.", "..")):
                continue
            assert not parts.scheme and not parts.netloc, f"{path.name}: {address}"
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.is_file(), f"{path.name}: {address}"
            looked_at[target.suffix] += 1
            if parts.fragment and target in pages and parts.fragment != "__codelineno":
                assert unquote(parts.fragment) in pages[target].anchors, f"{path.name}: {address}"
    assert min(looked_at[suffix] for suffix in (".html", ".png", ".ogg")) > 40


def test_nothing_is_loaded_from_another_host(built, pages):
    """No page, style or script names one, and the policy of each page lets the browser ask none."""
    for path, page in pages.items():
        assert not [address for address in page.loaded if urlsplit(address).netloc], path.name
        assert page.policy.split(";")[0].split() == [
            "default-src",
            "'self'",
            "file:",
            "data:",
            "blob:",
            "'unsafe-inline'",
        ]
    sheets = list(built.rglob("*.css"))
    assert sheets
    for path in sheets:
        named = [first or second for first, second in CSS_ADDRESS.findall(path.read_text("utf-8"))]
        assert all(urlsplit(address).scheme in ("", "data") and not urlsplit(address).netloc for address in named), path


@pytest.mark.parametrize("guide", guides(), ids=lambda path: path.stem)
def test_a_page_is_read_as_a_public_forge_reads_it(built, pages, guide):
    """As many items, tables, cells and blocks of code as CommonMark finds in it."""
    text = guide.read_text("utf-8")
    expected = Counter(token.tag for token in MarkdownIt().enable("table").parse(text) if token.nesting >= 0)
    found = pages[shown_at(built, guide)].count
    code = expected["code"]  # a block of code is one token
    assert {**{tag: expected[tag] for tag in STRUCTURE}, "pre": code} == {tag: found[tag] for tag in STRUCTURE}


def test_sounds_have_players_and_formulas_are_mathml(built, pages):
    gallery = "".join(page.read_text("utf-8") for page in (built / "docs").glob("gallery*.html"))
    for path in (ROOT / "docs" / "audio").glob("*.ogg"):
        assert f'src="audio/{path.name}"' in gallery
    formulas = (ROOT / "docs" / "scheme.md").read_text("utf-8").count("$$") // 2
    scheme = (built / "docs" / "scheme.html").read_text("utf-8")
    assert scheme.count('display="block"') == formulas > 3
    for path in pages:
        text = re.sub(r"<(script|pre|code)\b.*?</\1>", "", path.read_text("utf-8"), flags=re.DOTALL)
        assert "arithmatex" not in text and not re.search(r"\$[^$\n]*\\[a-z]+", text), path.name


@pytest.mark.hard
def test_a_broken_link_or_anchor_or_formula_stops_the_build(tmp_path):
    root = tmp_path / "project"
    (root / "docs").mkdir(parents=True)
    (root / "code.py").write_text('"""A `link`: [x](nowhere.md)."""\n', "utf-8")
    (root / "docs" / "examples").mkdir()
    (root / "docs" / "examples" / "play.py").write_text("print(1)\n", "utf-8")
    front = "# Front\n\n[guide](docs/guide.md#part), [code](code.py), [examples](docs/examples)\n"
    (root / "README.md").write_text(front, "utf-8")
    guide = root / "docs" / "guide.md"
    subprocess.run(["git", "init", "-q"], cwd=root, check=True)
    good = "# Guide\n\n## Part\n\n[front](../README.md), [code](../code.py)\n\n$x^2$\n"
    for text, code in (
        (good, 0),
        (good.replace("code.py", "cod.py"), 1),
        (good.replace("Part", "Other"), 1),
        (good.replace("x^2", r"\unknown"), 1),
        (good.replace("x^2", r"\begin{unknown} a & b \end{unknown}"), 1),
    ):
        guide.write_text(text, "utf-8")
        assert site.build(tmp_path / "built", root) == code, text
    assert "nowhere.md" in (tmp_path / "built" / "code.py.html").read_text("utf-8")
    assert 'href="play.py.html"' in (tmp_path / "built" / "docs" / "examples" / "index.html").read_text("utf-8")


def test_a_folder_that_is_no_site_is_left_alone(tmp_path, capsys):
    (tmp_path / "work.txt").write_text("mine", "utf-8")
    assert site.main([str(tmp_path)]) == 2 and "no site" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["work.txt"]


def test_lists_and_tables_need_no_empty_lines():
    told = "text\n- a\n- b\n  - c\n\n1. d\n   - e\nmore\n| x |\n| --- |\n| 1 |\n\n```sh\ntext\n- no\n```\n"
    wanted = "text\n\n- a\n- b\n    - c\n\n1. d\n    - e\nmore\n\n| x |\n| --- |\n| 1 |\n\n```sh\ntext\n- no\n```\n"
    assert site_hooks.on_page_markdown(told) == wanted


WIDTHS = (390, 1200)
HARNESS = """<!doctype html><pre id="result"></pre><script>
async function measure(address, width) {
  const frame = document.createElement("iframe");
  frame.style = `width: ${width}px; height: 800px; border: 0`;
  frame.src = address;
  document.body.append(frame);
  await new Promise(loaded => frame.onload = loaded);
  await new Promise(later => setTimeout(later, 300));
  const page = frame.contentWindow, wide = page.document.documentElement.scrollWidth;
  const asked = page.performance.getEntriesByType("resource").map(entry => entry.name);
  frame.remove();
  return {address, width, wide, asked};
}
(async () => {
  const found = [];
  for (const address of ADDRESSES) for (const width of WIDTHS) found.push(await measure(address, width));
  document.getElementById("result").textContent = JSON.stringify(found);
})();
</script>"""


class QuietHandler(SimpleHTTPRequestHandler):
    """A server of files that does not report each request."""

    def log_message(self, *words: object) -> None:
        pass


@pytest.mark.slow
def test_no_page_is_wider_than_its_window(built, pages, tmp_path):
    """In a browser, at the width of a telephone and of a desk; nor does a page ask another host for anything."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if not browser:
        pytest.skip("no Chromium")
    served = tmp_path / "served"
    shutil.copytree(built, served)
    addresses = sorted(path.relative_to(built).as_posix() for path in pages)
    script = HARNESS.replace("ADDRESSES", json.dumps(addresses)).replace("WIDTHS", json.dumps(WIDTHS))
    (served / "harness.html").write_text(script, "utf-8")
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(QuietHandler, directory=str(served)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    origin = f"http://127.0.0.1:{server.server_port}/"
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--virtual-time-budget=600000", "--dump-dom", f"{origin}harness.html"]
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    finally:
        server.shutdown()
    result = re.search(r'<pre id="result">(.*?)</pre>', run.stdout, re.DOTALL)
    found = json.loads(html.unescape(result[1])) if result else []
    assert len(found) == len(addresses) * len(WIDTHS), run.stderr[-2000:]
    assert not [(page["address"], page["width"], page["wide"]) for page in found if page["wide"] > page["width"]]
    asked = {address for page in found for address in page["asked"]}
    assert asked and all(address.startswith((origin, "data:", "blob:")) for address in asked)
