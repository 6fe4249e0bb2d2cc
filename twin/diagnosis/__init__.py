"""Which physical effect is missing in a model that was judged and does not agree with the measurement?

Read `procedure` first, the whole diagnosis on one page. `signatures` are absent effects as they would show in
these data, `evidence` weighs them, `screening` makes `candidates` of them, `refitting` fits the best,
`classes` says who mimics whom, `pairs` tries two at once; `searchorder` calls them in their order and
`verdicts` concludes.

Beside a verdict: `sizes` says what would have been found, `scaling` with what the misfit goes, `explanation`
what speaks for one effect, and `record` is what diagnosis.json holds.
"""
