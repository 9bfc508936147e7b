"""Folders of stacks written by hand: a cup on a book on a box, and a pen beside them, in each of the three formats."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

WIDTH_PX, HEIGHT_PX = 120, 90
VMRD_XML = """<annotation>
  <size><width>120</width><height>90</height><depth>3</depth></size>
  <object>
    <name>box</name>
    <bndbox><xmin>11</xmin><ymin>11</ymin><xmax>81</xmax><ymax>71</ymax></bndbox>
    <index>1</index>
    <father></father>
    <children><num>2</num><num>7</num></children>
  </object>
  <object>
    <name>Notebook </name>
    <bndbox><xmin>21</xmin><ymin>21</ymin><xmax>71</xmax><ymax>61</ymax></bndbox>
    <difficult>0</difficult>
    <index>2</index>
    <father><num>1</num></father>
    <children><num>7</num></children>
  </object>
  <object>
    <name>cup</name>
    <bndbox><xmin>31</xmin><ymin>31</ymin><xmax>51</xmax><ymax>51</ymax></bndbox>
    <index>7</index>
    <father><num>1</num><num>2</num></father>
    <children></children>
  </object>
  <object>
    <name>pen</name>
    <bndbox><xmin>91</xmin><ymin>11</ymin><xmax>101</xmax><ymax>81</ymax></bndbox>
    <index>4</index>
    <father/>
    <children/>
  </object>
</annotation>
"""
VMRD_GRASPS = "30 30 40 30 40 40 30 40 7 0 e\n92 30 100 30 100 40 92 40 4\n"
TREE = {"box-1": [], "book-2": ["box-1"], "cup-7": ["box-1", "book-2"], "pen-4": []}
BOXES = {1: [10, 10, 80, 70], 2: [20, 20, 70, 60], 7: [30, 30, 50, 50], 4: [90, 10, 100, 80]}
NAMES = {1: "box", 2: "book", 7: "cup", 4: "pen"}


def picture() -> bytes:
    """A JPEG file."""
    image = np.full((HEIGHT_PX, WIDTH_PX, 3), 90, np.uint8)
    return cv2.imencode(".jpg", image)[1].tobytes()


def put(file: Path, content: bytes | str) -> None:
    """Write a file and its folders."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content if isinstance(content, bytes) else content.encode())


def vmrd(folder: Path) -> Path:
    """VMRD: one picture for training, one for tests."""
    for name in ("00001", "00002"):
        put(folder / f"Annotations/{name}.xml", VMRD_XML)
        put(folder / f"Grasps/{name}.txt", VMRD_GRASPS)
        put(folder / f"JPEGImages/{name}.jpg", picture())
    put(folder / "ImageSets/Main/trainval.txt", "00001\n")
    put(folder / "ImageSets/Main/test.txt", "00002\n")
    return folder
