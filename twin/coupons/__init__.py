"""Tests of the silicone itself, beside the film: their files become curves of nominal stress with errors.

Read `pulltest` first: a table of twin.toml (`testtable`) becomes the loading branch of a test, and that the
curve which a fit takes. `course` finds slip, tears, holds and what is likely wrong, `exports` reads what an
instrument writes, its columns and their units.
"""
