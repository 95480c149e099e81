"""Studies beside the main job: charts, analytic flows, benchmarks, stability maps."""
