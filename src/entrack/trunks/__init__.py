"""Make a trunk: distil, fine-tune through the filter, quantise, or import one (extra `train`)."""
