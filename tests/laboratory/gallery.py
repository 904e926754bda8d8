"""Write the gallery of the guide, `.docs/gallery.md` and the pictures beside it.

    python -m laboratory.gallery FOLDER

FOLDER is that in which the commands of the page wrote their charts, by the option
`--output FOLDER`.
"""

import argparse
from pathlib import Path

from PIL import Image

from epcontact.studies import STUDIES

GUIDE = Path(__file__).parents[2] / ".docs"
PICTURES = GUIDE / "gallery"
#: Width of a picture in pixels, and the number of its colours.
WIDTH = 800
COLOURS = 64
HEAD = """# The gallery

Every chart answers the question that is its title.  Series differ in colour, marks and
dashes, so that a chart can be read in grey and by people with any colour vision.  Each
picture is written with its data (`.csv`), its caption (`.txt`) and as a vector graphic
(`.svg`).  The pictures of this page are those of the small sizes, which take seconds to
minutes; `--full` draws finer ones.
"""
CASE = """The case is that which `epcontact new rough` writes, without the theory and
its gate, and with these lines:

```toml
thermal_conductivities = [50.0, 150.0]
mean_pressure = [2e8, 5e8, 1e9, 2e9, 5e8, 1e8, 0.0]
```
"""
#: The pictures of results: heading, command, text, and the names of the pictures in the
#: folder, with captions of those that have no caption beside them.
RESULTS = (
    (
        "A load path that ends at no load",
        "epcontact run my-surface.toml --charts",
        CASE,
        {
            "my-surface/fast/power-spectrum": "",
            "my-surface/fast/loads-areas": "",
            "my-surface/fast/loads-gap": "",
            "my-surface/fast/loads-stiffness": "",
            "my-surface/fast/loads-thermal": "",
            "my-surface/fast/loads-percolation": "",
            "my-surface/fast/contact-bem-peak": "",
            "my-surface/fast/contact-bem": "",
        },
    ),
    (
        "Theory and boundary elements",
        "epcontact run paper-elastoplastic --charts",
        "",
        {
            "paper-elastoplastic/fast/persson-magnification": "",
            "paper-elastoplastic/fast/pressure-distribution": "",
            "paper-elastoplastic/fast/residuals": "",
        },
    ),
    (
        "A line contact",
        "epcontact run westergaard-line --charts",
        "",
        {"westergaard-line/fast/contact-bem": ""},
    ),
    (
        "Fields in three dimensions",
        "epcontact view results/my-surface/fast/bem-seed3-peak.vti "
        "--screenshot view.png",
        "",
        {"view": "The deformed surface under the largest load, with its pressures."},
    ),
    (
        "Where the methods converge",
        "epcontact stability",
        "",
        {
            "stability-capped": "",
            "stability-elastic": "",
            "stability-theory": "",
            "stability-fem": "",
        },
    ),
)


def picture(folder: Path, name: str, caption: str = "") -> list[str]:
    """Copy a picture of a folder into the guide, smaller, and return its lines of the
    page: the picture and its caption.

    `name` is its path in the folder without an ending.  The caption is that beside it
    if none is given.
    """
    source = folder / f"{name}.png"
    target = PICTURES / f"{name.replace('/', '-')}.png"
    with Image.open(source) as image:
        height = round(image.height * WIDTH / image.width)
        small = image.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
    method = Image.Quantize.MAXCOVERAGE
    small.quantize(COLOURS, method).save(target, optimize=True)
    caption = caption or source.with_suffix(".txt").read_text(encoding="utf-8").strip()
    words = "".join(f"\\{c}" if c in r"\*_[]<>$^`" else c for c in caption)
    question, mark, _ = words.partition("?")
    return [f"![{question}{mark}](gallery/{target.name})", "", words, ""]


def section(title: str, command: str, text: str = "") -> list[str]:
    """Return the lines of the page that begin a section, with its command."""
    return [f"## {title}", "", text, "```bash", command, "```", ""]


def page(folder: Path) -> str:
    """Return the page as Markdown, and copy its pictures from the folder."""
    lines = [HEAD]
    for title, command, text, names in RESULTS:
        lines += section(title, command, text)
        for name, caption in names.items():
            lines += picture(folder, name, caption)
    for study in STUDIES.values():
        stems = [path.stem for path in sorted(folder.glob(f"{study.name}*.png"))]
        own = [stem for stem in stems if stem.rstrip("-0123456789") == study.name]
        lines += section(study.description, f"epcontact chart {study.name}")
        for stem in own:
            caption = (folder / f"{stem}.txt").read_text(encoding="utf-8").strip()
            # The rest is the description of the study, which is the same for all.
            begin = caption.split(f" {study.description}")[0]
            lines += picture(folder, stem, begin)
        if not own:
            lines += ["This page has no picture of it.", ""]
    text = "\n".join(line for line in lines)
    return text.replace("\n\n\n", "\n\n").rstrip() + "\n"


def main() -> None:
    """Write the page and its pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    PICTURES.mkdir(exist_ok=True)
    (GUIDE / "gallery.md").write_text(page(folder), encoding="utf-8")


if __name__ == "__main__":
    main()
