"""Drawing: graphs, small pictures, and drapes in three dimensions.

svg, axes, line_graphs: graphs; pictures: silhouettes and differences; drape_view: renders a draped cloth.
"""
