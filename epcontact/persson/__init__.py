"""persson"""
