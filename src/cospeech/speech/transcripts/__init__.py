"""Files of word times, one module a family of formats: each turns a file's text into a `Transcript`."""
