"""A page in the browser that shows clouds, cameras and drives in 3-D, drawn by `viser` (the extra `view`).

scene.py     what a page shows: shots of a rig, each with a cloud, lines and surfaces
clouds.py    the cloud of a pair's maps, and its colours
grids.py     heights on a grid as a surface
placing.py   where the viewer stands
page.py      the page and its controls
show.py      what --view does: open the page, print its address, wait for Ctrl-C
"""
