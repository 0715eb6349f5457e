"""Readers of what anybody may have written, by hand and before pyarrow sees it.

A run may come from elsewhere: mailed, downloaded, cut by a power failure. pyarrow takes the sizes
that a file states at their word, so that a kilobyte can ask for all memory, and has no public way
to bound what it allocates. So the footers of Parquet files and the frames of Arrow streams are
read here first, and refused where they ask for more than a file of their size can hold; the same
goes for the fields of a manifest.
"""
