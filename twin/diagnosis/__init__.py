"""The physical effect that is missing in a model which does not agree with the measurement.

Read `procedure` first, the whole diagnosis on one page. `hypotheses` is what may be missing. `signatures` are
hypotheses as they would show in these data, `evidence` weighs them, `screening` ranks them to first order,
`refitting` fits one, and `shortlist` says which; `deciding` concludes from all, `grades` says how
sure that is, `wording` tells it.

Beside a verdict: `lawresidual` says how far a law is off, `swing` what a frequency tells of the mass,
`classes` who mimics whom, `sizes` what would have been found, `scaling` with what the misfit goes,
`explanation` what speaks for one effect, and `diagnosisrecord` is what diagnosis.json holds.
"""
