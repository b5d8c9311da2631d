"""Clocks against log time: one clock model, the vehicle's boot clock, UTC."""
