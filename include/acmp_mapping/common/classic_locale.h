#pragma once

#include <locale.h>  // NOLINT(modernize-deprecated-headers): locale_t
#include <clocale>

namespace acmp {

/// While it lives, numbers that this thread reads and writes with C's functions (strtod, stod, printf) have a decimal
/// point, also where the process has called setlocale, as a Python script or a desktop program may: in de_DE "0.5"
/// would be 0, and 0.5 would be "0,5". Streams are given std::locale::classic() where they are made.
class ClassicLocale {
 public:
  ClassicLocale() : previous_(uselocale(Classic())) {}
  ~ClassicLocale() { uselocale(previous_); }
  ClassicLocale(const ClassicLocale&) = delete;
  ClassicLocale& operator=(const ClassicLocale&) = delete;

 private:
  static locale_t Classic() {
    static const locale_t classic = newlocale(LC_ALL_MASK, "C", nullptr);
    return classic;
  }

  const locale_t previous_;
};

}  // namespace acmp
