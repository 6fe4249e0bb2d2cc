"""Frames become tracks: one homography a mark and frame, with its covariance.

`locating` finds markers in one picture; `reference` averages each mark over the first seconds (with
`printed`, `dots`, `identity`); `registration` aligns it in every later frame (on `sampling`; `fallback`
and `uneven` where that fails or is disturbed); `tracks` is the loop over the film. `turns` reads
rotations off tracks; `dic` follows a speckled surface in the same way.
"""
