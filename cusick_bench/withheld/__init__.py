"""Withheld cases: drapes whose unmodelled effect is sealed, made, answered and scored."""
