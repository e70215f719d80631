"""Run the hundreds of scenarios that a sweep file describes, and collect their scores in one labelled grid.

A sweep that was interrupted can be resumed:

sweep = load_sweep("gain_noise")
grid = run_sweep(sweep, "runs/gain_noise", jobs=2)
grid["r2"].sel(observer="momentum", point="left", axis="z")
"""
