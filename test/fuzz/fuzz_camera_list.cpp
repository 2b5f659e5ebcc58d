// A scene's cameras.txt.

#include "acmp_mapping/dataset/camera_list.h"
#include "fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const acmp::fuzz::Folder folder;
  const auto path = folder.Write("cameras.txt", acmp::fuzz::Bytes(data, size).Rest());
  acmp::fuzz::MayRefuse([&] { acmp::ReadCameraList(path); });
  return 0;
}
