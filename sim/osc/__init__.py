"""OpenSCENARIO DSL: a scenario file as text, read and checked into definitions that a behaviour tree is built from.

A file passes through three forms, each a set of frozen values: `syntax`, what is written, with places (`grammar`, `building`);
`declarations`, what names mean (`declaring`); `definition`, what scenarios do with names resolved, types agreed and units turned
into SI (`checking` and the checkers of members, expressions and what is done). `reading` leads through them.
"""
