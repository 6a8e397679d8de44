"""The painter of synthetic people: solids with their looks, traced into pictures, and the places they stand in."""
