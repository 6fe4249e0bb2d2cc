"""Where every mark is in every frame: one homography a mark and frame, with its covariance.

Read `reference` first: it averages each mark over the first seconds (with `printed`, `dots`, `identity`).
`registration` aligns that average in every later frame, on the compiled loops of `sampling`; `fallback` and
`uneven` help where this fails or is disturbed. `tracks` is the loop over the film, `methods` names how a
mark was placed, `turns` reads rotations, `corrections` is what a person mends. `locating` finds markers in a
single picture, `skimming` looks at some frames of a film, `textures` finds natural features,
`dic` follows a speckled surface.
"""
