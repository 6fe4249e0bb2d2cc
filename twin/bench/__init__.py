"""What a command that judges a model starts from: targets, model and whitener, and the runs that still
hold.

Read `workbench` first: a project as its model and its targets. `positions` finds the points that twin.toml
states in mm on the finger; `meshshapes` says what there is to say of a mesh. `fits` tells which runs still
belong to the project, `effectlaws` which law of an effect was kept, `waterfall` how the error fell until now.
`engines` finds the program that twin.toml names to solve the model, `knownvalues` reads what it says of
parameters and errors beforehand, `losses` which stages do without, `fittedby` tells both of a fit.
`comparison` writes what a judged model shows and what it was judged by, `curvewords` what it says of tests of
the silicone, `caches` keeps what is dear to make.
`effectchange` refits the model with other effects; `predicting` asks it what nobody has measured, `leftopen`
how uncertain that is, `inverting` which pressure gives a wanted displacement, `blocking` how hard the finger
presses, `touching` how hard on an object that it meets; `profiling` asks how far each parameter may go,
`sampling` how likely all of them are together, `tradingoff` what fits one part of the targets at the cost of
another; `askedranges` reads what is to be varied, and `exploring` solves such fingers; `othermodels` says in
what two projects' models differ.
"""
