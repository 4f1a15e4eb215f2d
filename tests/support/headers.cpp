// Only for the precompiled headers of all tests.
