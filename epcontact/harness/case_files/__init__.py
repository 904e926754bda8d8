"""Case files: tables of TOML that become a Case, or one sentence about each mistake.

text          TOML with variants and with values by size
model, axes   the tables, their keys and types, and the Case that has them; the table [sweep]
case          cases are read and checked
mistakes      the sentences about mistakes, and the table of all keys
citations     the papers and the software that a case rests on
"""
