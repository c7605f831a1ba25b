-- The published filter and UART reader of a SonicSurface at a line whose bits take BIT_PS. Reads bytes from INPUT, a line
-- each, sends them back to back, and writes those that are read to OUTPUT.
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use std.textio.all;

entity uart_bench is
  generic (
    INPUT    : string  := "bytes.txt";
    OUTPUT   : string  := "read.txt";
    BIT_PS   : natural := 4340278;
    CLOCK_PS : natural := 97656);
end uart_bench;

architecture test of uart_bench is
  signal clk, valid, filtered : std_logic := '0';
  signal serial : std_logic := '1';
  signal value : std_logic_vector(7 downto 0);
  signal is_over : boolean := false;
begin
  filter : entity work.RSSFilter_1 generic map (TAPS => 8) port map (clk => clk, bit_in => serial, bit_out => filtered);
  reader : entity work.UARTReader generic map (g_CLKS_PER_BIT => 45)
    port map (i_Clk => clk, i_RX_Serial => filtered, o_RX_DV => valid, o_RX_Byte => value);
  process begin
    while not is_over loop
      clk <= '1'; wait for CLOCK_PS / 2 * 1 ps; clk <= '0'; wait for CLOCK_PS / 2 * 1 ps;
    end loop;
    wait;
  end process;
  process
    file source : text open read_mode is INPUT;
    variable row : line;
    variable sent : integer;
    variable bits : std_logic_vector(9 downto 0);
  begin
    wait for 20 us;
    while not endfile(source) loop
      readline(source, row); read(row, sent);
      bits := '1' & std_logic_vector(to_unsigned(sent, 8)) & '0';
      for place in 0 to 9 loop
        serial <= bits(place); wait for BIT_PS * 1 ps;
      end loop;
    end loop;
    wait for 100 us;
    is_over <= true;
    wait;
  end process;
  process (clk)
    file sink : text open write_mode is OUTPUT;
    variable row : line;
  begin
    if rising_edge(clk) and valid = '1' then
      write(row, to_integer(unsigned(value))); writeline(sink, row);
    end if;
  end process;
end test;
