"""Known motion becomes film, printed sheets and pictures: the reverse of measuring.

`artwork` has the shapes of markers, dots and boards in mm; `synthetic` films them; `overlays` draws
tracks onto a frame.
"""
