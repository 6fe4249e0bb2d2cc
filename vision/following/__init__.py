"""Place of every mark in every frame: one homography a mark and frame, with its covariance.

Read `tracks` first: the records of what was followed. `tracking` is the loop over the film. It starts from
`reference`, which averages each mark over the first seconds: `firstpictures` finds the marks there,
`printedpattern` their true centres. `registration` aligns that average in every later frame, on the compiled
loops of `sampling`. Where this fails or is disturbed, `fallback`, `blurred` and `influence` help. Plain dots
are found by `dots` and told apart by `identity`.

`markrotations` reads rotations from the tracks, `corrections` is what a person mends. `markercentres`
measures the markers of a single picture, `preview` looks at some frames of a film, `features` finds natural
features. `edges` finds the edge of a body along lines through it. `subsetbias` corrects
the subsets of a speckled face where strain has a gradient.
"""
