// What an earlier run left in its folder: run.txt, files.txt, summary.json.

#include "fuzz/fuzz_input.h"
#include "output_folder.h"

ACMP_FUZZ_TARGET(output_folder) {
  using namespace acmp;
  static const fuzz::Folder folder;
  const auto parts = fuzz::Parts(data, size, 3);
  const auto write = [&] {
    folder.Write("run.txt", parts[0]);
    folder.Write("files.txt", parts[1]);
    folder.Write("summary.json", parts[2]);
  };
  write();
  fuzz::MayRefuse([&] { OutputFolder(folder.path(), {{"preset", "acmp"}}, false); });
  write();
  fuzz::MayRefuse([&] { OutputFolder(folder.path(), {{"preset", "acmp"}}, true); });
  return 0;
}
