"""Writes image sets with Pillow, and with numpy what their samples are.

Arguments: a folder. Written to it:
  wool.zip            9 views x 9 lights, 12 x 8 texels, JPEG, named as in UBO2003
  wool.npy            its linear samples [view][light][rgb][y][x], f32
  capture/            PNG, 8 and 16 bit, one view, 5 lights, with a table of directions in radians
  capture.npy         its linear samples [light][rgb][y][x], f32
"""

import csv
import io
import math
import pathlib
import sys
import zipfile

import numpy as np
from PIL import Image

folder = pathlib.Path(sys.argv[1])
random = np.random.default_rng(7)


def linear(srgb):
    """IEC 61966-2-1, for values from 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def planes(image, largest):
    """[y][x][rgb] or [y][x] to linear [rgb][y][x]."""
    image = np.asarray(image, dtype=np.float64) / largest
    if image.ndim == 2:
        image = np.stack([image] * 3, axis=-1)
    return linear(image).transpose(2, 0, 1).astype(np.float32)


# UBO2003: a smooth picture for each pair, in a shuffled zip, with files beside them that are no images.
directions = [(0, 0)] + [(30, phi) for phi in range(0, 360, 90)] + [(60, phi) for phi in range(45, 360, 90)]
x, y = np.meshgrid(np.linspace(0, 1, 12), np.linspace(0, 1, 8))
entries, samples = [], []
for number, (tv, pv) in enumerate(directions):
    for tl, pl in directions:
        red = 0.2 + 0.6 * x * math.cos(math.radians(tl))
        green = 0.3 + 0.5 * y * math.cos(math.radians(tv))
        blue = 0.5 + 0.3 * math.sin(math.radians(pl)) * x + 0.1 * math.cos(math.radians(pv)) * y
        picture = np.rint(np.stack([red, green, blue], axis=-1) * 255).astype(np.uint8)
        encoded = io.BytesIO()
        Image.fromarray(picture).save(encoded, "JPEG", quality=98, subsampling=0)
        name = f"WOOL/tv{tv:03}_pv{pv:03}/{number:05} tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}.jpg"
        entries.append((name, encoded.getvalue()))
        # What Pillow's own decoder makes of it: the loss of JPEG is not the reader's.
        samples.append(planes(Image.open(io.BytesIO(encoded.getvalue())).convert("RGB"), 255))
entries += [("WOOL/readme.txt", b"wool"), ("WOOL/Thumbs.db", b"\0" * 99), ("__MACOSX/WOOL/._x.jpg", b"x")]
with zipfile.ZipFile(folder / "wool.zip", "w") as archive:
    for index in random.permutation(len(entries)):
        name, content = entries[index]
        method = zipfile.ZIP_DEFLATED if index % 2 else zipfile.ZIP_STORED
        archive.writestr(name, content, compress_type=method)
np.save(folder / "wool.npy", np.reshape(samples, (9, 9, 3, 8, 12)))

# A capture from one view: deep, shallow, grey and transparent pictures.
capture = folder / "capture"
capture.mkdir()
pictures = [
    ("a.png", Image.fromarray(random.integers(0, 256, (5, 4, 3), np.uint8)), 255),
    ("b.png", Image.fromarray(random.integers(0, 256, (5, 4), np.uint8)), 255),
    ("c.png", Image.fromarray(random.integers(0, 65536, (5, 4), np.uint16)), 65535),
    ("d.png", Image.fromarray(random.integers(0, 256, (5, 4, 4), np.uint8), "RGBA"), 255),
    ("e.png", Image.fromarray(random.integers(0, 256, (5, 4, 3), np.uint8)).quantize(16), 255),
]
samples = []
with open(capture / "lights.csv", "w", newline="") as table:
    rows = csv.writer(table)
    rows.writerow(["theta_light_rad", "phi_light_rad", "file"])
    for index in [3, 1, 4, 0, 2]:
        rows.writerow([0.2 * index, 1.0 * index, pictures[index][0]])
for name, picture, largest in pictures:
    picture.save(capture / name)
    read = Image.open(capture / name)
    read = read.convert("RGB") if read.mode in ("P", "RGBA") else read
    samples.append(planes(read, largest))
np.save(folder / "capture.npy", np.array(samples))
