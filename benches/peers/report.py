"""Draws the peers' plots of benches/results/codec.json to docs/images; tables and all other plots are written by `cargo xtask report`.

    python report.py

Plain SVG without any library, so that a difference between two runs can be read as text.
"""

import math

from program import REPOSITORY, RESULTS, read_json, write_text

# J2K's bytes at each target, at most so many times; promised for pages, headers and directory.
GOALS = {0.12: 1.10, 0.05: 1.15, 0.015: 1.20}
SPEED_GOAL = 5
INK, FAINT = "#24292f", "#d0d7de"
SERIES = {
    "pages": ("#0969da", "Eigentile: all mips, headers, directory"),
    "archive": ("#8ac4ff", "the same with eigen-ABRDF columns"),
    "jpegxl": ("#bf8700", "JPEG XL, finest mip only"),
}


class Panels:
    """Dot plots side by side that share their rows; a logarithmic axis each."""

    label_width, panel_width, gap, top, row_height = 110, 230, 26, 62, 20

    def __init__(self, title, labels, panels, low, high, ticks):
        self.low, self.high, self.ticks = low, high, ticks
        self.labels, self.parts = labels, []
        self.width = self.label_width + panels * (self.panel_width + self.gap)
        self.bottom = self.top + len(labels) * self.row_height
        self.height = self.bottom + 52
        self.text(8, 18, title, weight="bold", size=13)
        for row, label in enumerate(labels):
            self.text(self.label_width - 8, self.y(row) + 4, label, anchor="end")

    def y(self, row):
        return self.top + (row + 0.5) * self.row_height

    def x(self, panel, value):
        value = min(max(value, self.low), self.high)
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return self.label_width + panel * (self.panel_width + self.gap) + share * self.panel_width

    def text(self, x, y, text, anchor="start", weight="normal", size=11):
        self.parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-weight="{weight}" font-size="{size}">{text}</text>'
        )

    def line(self, panel, value, colour, dash=""):
        x = self.x(panel, value)
        dash = f' stroke-dasharray="{dash}"' if dash else ""
        self.parts.append(f'<path d="M{x:.1f} {self.top}V{self.bottom}" stroke="{colour}"{dash}/>')

    def panel(self, panel, title, goal):
        self.text(self.x(panel, self.low), self.top - 10, title, weight="bold")
        for tick in self.ticks:
            self.line(panel, tick, INK if tick == 1 else FAINT)
            self.text(self.x(panel, tick), self.bottom + 14, f"{tick:g}", anchor="middle", size=10)
        self.line(panel, goal, "#cf222e", dash="4 3")

    def dot(self, panel, row, value, colour, name):
        x, y = self.x(panel, value), self.y(row)
        self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{colour}"><title>{name}: {value:.3f}</title></circle>')

    def legend(self, entries):
        x, y = 8, self.height - 12
        for colour, name in entries:
            self.parts.append(f'<circle cx="{x + 5}" cy="{y - 4}" r="4.5" fill="{colour}"/>')
            self.text(x + 14, y, name)
            x += 34 + 6.2 * len(name)
        self.parts.append(f'<path d="M{x} {y - 4}h18" stroke="#cf222e" stroke-dasharray="4 3"/>')
        self.text(x + 24, y, "goal")

    def svg(self):
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{self.width}" height="{self.height}" '
            f'viewBox="0 0 {self.width} {self.height}" font-family="sans-serif" fill="{INK}">\n'
            f'<rect width="100%" height="100%" fill="#fff"/>\n' + "\n".join(self.parts) + "\n</svg>\n"
        )


def points_of(materials):
    """(row, target, point) of all that is measured at a target."""
    for row, material in enumerate(materials):
        for point in material["points"]:
            yield row, point["target"], point


def codec_plots(materials):
    targets = sorted({target for _, target, _ in points_of(materials)}, reverse=True)
    labels = [material["name"] for material in materials]
    ticks = [0.5, 0.7, 1, 1.4, 2, 2.8, 4]
    plot = Panels("Bytes relative to JPEG 2000 (OpenJPEG) at the same error", labels, len(targets), 0.5, 4, ticks)
    for panel, target in enumerate(targets):
        plot.panel(panel, f"relative RMSE {target:g}", GOALS.get(target, 1))
    for row, target, point in points_of(materials):
        panel, j2k = targets.index(target), point["peers"].get("jpeg2000")
        if j2k is None:
            continue
        values = {"archive": j2k["archive_bytes_ratio"], "pages": j2k["bytes_ratio"]}
        if "jpegxl" in point["peers"]:
            values["jpegxl"] = point["peers"]["jpegxl"]["bytes"] / j2k["bytes"]
        for name, value in values.items():
            plot.dot(panel, row, value, SERIES[name][0], f"{labels[row]}, {SERIES[name][1]}")
    plot.legend(SERIES.values())
    write_text(REPOSITORY / "docs/images/codec-bytes.svg", plot.svg())

    ticks = [0.5, 1, 2, 5, 10, 20, 50]
    plot = Panels("Decoding speed relative to OpenJPEG, one core, f32 out", labels, len(targets), 0.3, 60, ticks)
    for panel, target in enumerate(targets):
        plot.panel(panel, f"relative RMSE {target:g}", SPEED_GOAL)
    for row, target, point in points_of(materials):
        panel, decode = targets.index(target), point["decode"]
        if "ratio_to_jpeg2000" not in decode:
            continue
        plot.dot(panel, row, decode["ratio_to_jpeg2000"], "#0969da", labels[row])
        plot.dot(panel, row, decode["finest_ratio_to_jpeg2000"], "#8ac4ff", labels[row])
        if "jpegxl_mb_per_s" in decode:
            ratio = decode["jpegxl_mb_per_s"] / decode["jpeg2000_mb_per_s"]
            plot.dot(panel, row, ratio, SERIES["jpegxl"][0], f"{labels[row]}, JPEG XL")
    entries = [("#0969da", "Eigentile, samples of all mips"), ("#8ac4ff", "Eigentile, samples of the finest mip only")]
    plot.legend([*entries, (SERIES["jpegxl"][0], "JPEG XL")])
    write_text(REPOSITORY / "docs/images/codec-speed.svg", plot.svg())


def main():
    codec = read_json(RESULTS / "codec.json")
    if codec and codec["materials"]:
        codec_plots(codec["materials"])
    print("now `cargo xtask report` writes the tables of docs/results.md")


if __name__ == "__main__":
    main()
