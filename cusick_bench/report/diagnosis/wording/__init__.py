"""How the page of a diagnosis says things: names, numbers, verdicts, effects and named causes."""
