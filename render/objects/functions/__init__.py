"""Functions of position as solids: expression trees and a user's Warp function."""
