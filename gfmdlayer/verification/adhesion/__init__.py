"""Adhesion: closed forms of JKR, Johnson, Maugis and pull-in; instabilities of films; rate dependence."""
