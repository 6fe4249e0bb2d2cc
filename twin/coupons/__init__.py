"""Tests of the silicone itself, beside the film: their files become curves of nominal stress with errors.

Read `curve` first: what a fit takes of a test. `pulltest` makes it of a table of twin.toml: the loading branch,
and how far it is used. `exports` reads what an instrument writes, `headings` knows its columns and units, and
`plausible` says what is likely wrong with it.
"""
