"""The painter of synthetic people: solids with their materials, traced into pictures, and the places they stand in."""
