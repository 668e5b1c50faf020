"""Drawing: figures of pages, small pictures, and drapes in three dimensions.

palette, inline_svg, row_names: matplotlib figures as elements of a page; radius_over_angle, line_graphs: figures that
several pages share; pictures: silhouettes and differences; drape_view: renders a draped cloth.
"""
