"""Kinds of marks: what is glued or sprayed on, each in one file.

`markkind` is what every kind can tell of itself. The kinds are `coded` (a marker with its own number),
`plaindot` (a dot without a code), `texturepatch` (a natural feature) and `facepoint` (a part of a speckled
face). How they are followed through a film stands in `vision.following`.
"""
