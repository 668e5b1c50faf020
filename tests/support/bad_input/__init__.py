"""The corpus of bad and odd inputs: a module a kind of input, each with its `CASES`; `run_case` tries one of them."""
