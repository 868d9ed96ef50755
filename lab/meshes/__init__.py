"""glTF meshes: an asset as it is read (`asset`, `gltf`), poses (`posing`), colours (`appearance`)."""
