"""Does the model agree with the measurement, where not, and which physical effect is missing?

One model: `whitening` turns residuals into independent values, `comparison` tests them, `frame` tests the
fixed markers, `fitting` fits parameters, and `judging` does it until fit and errors belong together;
`intervals`, `sharederrors` and `heldout` say more of a judged model.

What is missing: read `procedure` first, the whole diagnosis on one page. `rivals` are absent effects as they
would show, `evidence` weighs them, `screening` makes `candidates` of them, `refitting` fits the best,
`classes` says who mimics whom, `pairs` tries two at once; `attempts` calls them in their order and `verdicts`
concludes.

Beside a verdict: `completing`, with `sizes` (what would have been found), `explanation` (what speaks for an
effect) and `experiments` (what to do next, by `planned`, `outlook` and `mimicry`).
"""
