"""The face as mathematics: coefficients by name, morphable models and their mesh, and the least squares of a fit."""
