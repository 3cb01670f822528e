"""Maps for people and GIS: pictures, pages, reports and files."""
