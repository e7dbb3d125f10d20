"""Read containers of arrays, such as HDF5, TDMS and spreadsheets, each with its own library."""
