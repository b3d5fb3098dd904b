"""stub"""
CATALOGUE = []
