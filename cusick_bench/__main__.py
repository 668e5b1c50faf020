"""`python -m cusick_bench` is `cusick-bench`."""

from cusick_bench.cli import main

main()
