"""shinolab's AUTD3 through the vendor's package."""
