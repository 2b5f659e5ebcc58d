// A PNG or JPEG file as picture, as mask and as 16-bit depth.

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/masks.h"
#include "fuzz/fuzz_input.h"

ACMP_FUZZ_TARGET(image) {
  using namespace acmp;
  constexpr int kLargeSide = 1024;  // what announces more takes memory and time, as it may
  static const fuzz::Folder folder;
  const std::string_view content = fuzz::Bytes(data, size).Rest();
  fuzz::MayRefuse([&] {
    const ImageSize image = EncodedImageSize("image", content);
    const auto path = folder.Write("image.png", content);
    fuzz::MayRefuse([&] { ReadColorImage(path, {8, 6}); });
    if (image.width > kLargeSide || image.height > kLargeSide) return;
    fuzz::MayRefuse([&] { ReadMask(path); });
    ReadDepth(path);
  });
  return 0;
}
