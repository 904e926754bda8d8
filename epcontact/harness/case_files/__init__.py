"""Case files: tables of TOML that become a Case, or one sentence about each mistake.

text              TOML with variants and with values by size
tables, axes      the tables: their keys, types, units and meaning; axes: the table [sweep]
model             a Case at one size: its tables, and what follows from them
case              cases are read and checked
mistakes          the sentences about mistakes, and the table of all keys
citations         the papers and the software that a case rests on
"""
