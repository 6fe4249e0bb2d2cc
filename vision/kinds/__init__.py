"""Kinds of marks: what is glued or sprayed on, each in one file.

`markkind` is what every kind can tell of itself; `coded`, `plaindot`, `texturepatch` and
`facepoint` are the kinds. How they
are followed through a film stands in `vision.following`.
"""
