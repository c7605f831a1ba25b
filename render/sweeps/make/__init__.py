"""Units of a sweep made into results: chunks are rendered, measured, sampled and kept."""
