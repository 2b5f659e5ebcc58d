// A COLMAP model, binary: cameras.bin, images.bin, points3D.bin.

#include "fuzz/fuzz_scene.h"

ACMP_FUZZ_TARGET(colmap_binary) {
  static const acmp::fuzz::SceneFolder folder;
  const auto parts = acmp::fuzz::Parts(data, size, 3);
  folder.Write("sparse/cameras.bin", parts[0]);
  folder.Write("sparse/images.bin", parts[1]);
  folder.Write("sparse/points3D.bin", parts[2]);
  folder.Read(acmp::SceneFormat::kColmap);
  return 0;
}
