"""`python -m cusick_bench.cli` is `cusick-bench`."""

from cusick_bench.cli import main

main()
