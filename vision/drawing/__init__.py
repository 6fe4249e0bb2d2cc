"""Pictures and film that this package draws itself.

`synthetic` draws film and board pictures of a known motion, to test and to plan with. `overlays` draws what
was followed onto a frame of the film, or a circle round every mark of a picture.
"""
